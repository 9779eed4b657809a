"""The small CGIs: what the camera is, whether it is ready, how large its picture is. Pure answers."""

from __future__ import annotations

from ptzd.sim.auth import Role, User
from ptzd.sim.profile import Profile

_APIS = (
    ("api-discovery", "1.0", "API Discovery Service"),
    ("basic-device-info", "1.1", "Basic Device Information"),
    ("guard-tour", "1.0", "Guard Tour"),
    ("param-cgi", "1.0", "Legacy Parameter Handling"),
    ("ptz-control", "1.0", "PTZ Control"),
    ("systemready", "1.1", "Systemready"),
    ("user-management", "1.1", "User Management"),
)
_UNRESTRICTED = ("Brand", "ProdFullName", "ProdNbr", "ProdShortName", "ProdType", "ProdVariant", "SerialNumber",
                 "Version", "WebURL", "HardwareID")  # fmt: skip

Json = dict[str, object]


def error(code: int, message: str, context: object = None) -> Json:
    """Error of a JSON API."""
    base: Json = {"apiVersion": "1.0", "error": {"code": code, "message": message}}
    return base | ({"context": context} if context is not None else {})


def properties(profile: Profile) -> dict[str, str]:
    """Property list of basicdeviceinfo.cgi."""
    return {
        "Architecture": "armv7hf",
        "ProdNbr": profile.product,
        "HardwareID": "7C9.2",
        "Version": profile.firmware,
        "ProdFullName": profile.full_name,
        "Brand": "AXIS",
        "ProdType": "PTZ Network Camera",
        "Soc": "Axis Artpec-6",
        "SocSerialNumber": "00000000-00000000-442C2402-87C00153",
        "WebURL": "http://www.axis.com",
        "ProdVariant": "",
        "SerialNumber": profile.serial,
        "ProdShortName": f"AXIS {profile.product}",
        "BuildDate": "Jun 08 2021 10:17",
    }


def basic_device_info(profile: Profile, message: Json, user: User | None) -> Json:
    """Answer of basicdeviceinfo.cgi; without a user only what is unrestricted."""
    method, context = message.get("method"), message.get("context")
    everything = properties(profile)
    base: Json = {"apiVersion": "1.3", "method": method}
    if context is not None:
        base["context"] = context
    match method:
        case "getSupportedVersions":
            return base | {"data": {"apiVersions": ["1.3"]}}
        case "getAllUnrestrictedProperties":
            return base | {"data": {"propertyList": {name: everything[name] for name in _UNRESTRICTED}}}
        case "getAllProperties" if user is not None:
            return base | {"data": {"propertyList": everything}}
        case "getProperties" if user is not None:
            parameters = message.get("params")
            wanted = parameters.get("propertyList", []) if isinstance(parameters, dict) else []
            return base | {"data": {"propertyList": {name: everything[name] for name in wanted if name in everything}}}
        case _:
            return error(2004, "Method not supported", context)


def api_discovery(message: Json) -> Json:
    """Answer of apidiscovery.cgi."""
    method, context = message.get("method"), message.get("context")
    base: Json = {"method": method, "apiVersion": "1.0"}
    if context is not None:
        base["context"] = context
    link = "https://www.axis.com/partner_pages/vapix_library/#/"
    if method == "getApiList":
        apis = [{"id": name, "version": version, "name": title, "docLink": link} for name, version, title in _APIS]
        return base | {"data": {"apiList": apis}}
    if method == "getSupportedVersions":
        return base | {"data": {"apiVersions": ["1.0"]}}
    return error(2004, "Method not supported", context)


def system_ready(message: Json, *, ready: bool, uptime_s: float, boot_id: str) -> Json:
    """Answer of systemready.cgi."""
    method, context = message.get("method"), message.get("context")
    base: Json = {"apiVersion": "1.3", "method": method}
    if context is not None:
        base["context"] = context
    if method == "systemready":
        state = {"systemready": "yes" if ready else "no", "needsetup": "no", "uptime": str(int(uptime_s))}
        return base | {"data": state | {"bootid": boot_id, "previewmode": "no"}}
    if method == "getSupportedVersions":
        return base | {"data": {"apiVersions": ["1.0", "1.1", "1.2", "1.3"]}}
    return error(2004, "Method not supported", context)


def user_groups(user: User) -> str:
    """Answer of usergroup.cgi: the name, then the groups."""
    groups = {Role.VIEWER: "viewer", Role.OPERATOR: "operator viewer", Role.ADMINISTRATOR: "admin operator viewer"}
    return f"{user.name}\r\n{groups[user.role]}{' ptz' if user.ptz else ''}\r\n"
