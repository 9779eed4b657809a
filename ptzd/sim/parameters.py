"""The parameter tree of a simulated camera: what param.cgi lists and changes. Pure."""

from __future__ import annotations

import fnmatch

from ptzd.sim.auth import Role
from ptzd.sim.profile import Profile

_SUPPORT = (
    ("AbsoluteBrightness", True), ("AbsoluteFocus", True), ("AbsoluteIris", True), ("AbsolutePan", True),
    ("AbsoluteTilt", True), ("AbsoluteZoom", True), ("ActionNotification", True), ("AreaZoom", True),
    ("AutoFocus", True), ("AutoIrCutFilter", True), ("AutoIris", True), ("Auxiliary", True), ("BackLight", True),
    ("ContinuousBrightness", False), ("ContinuousFocus", True), ("ContinuousIris", False), ("ContinuousPan", True),
    ("ContinuousTilt", True), ("ContinuousZoom", True), ("DevicePreset", False), ("DigitalZoom", False),
    ("GenericHTTP", False), ("IrCutFilter", True), ("JoyStickEmulation", True), ("LensOffset", False),
    ("OSDMenu", False), ("ProportionalSpeed", True), ("RelativeBrightness", True), ("RelativeFocus", True),
    ("RelativeIris", True), ("RelativePan", True), ("RelativeTilt", True), ("RelativeZoom", True),
    ("ServerPreset", True), ("SpeedCtl", True),
)  # fmt: skip
_QUEUE = (
    ("Administrator", 10, 60, "activity"), ("Operator", 30, 60, "activity"), ("Viewer", 50, 60, "timespan"),
    ("Event", 20, 20, "activity"), ("Autotracking", 35, 60, "infinity"), ("Guardtour", 40, 60, "infinity"),
    ("Onvif", 0, 60, "infinity"),
)  # fmt: skip
VIEWER_GROUPS = ("Brand", "GuardTour", "Image", "ImageSource", "PTZ", "Properties")
"""Groups that a viewer may read."""


def factory_parameters(profile: Profile) -> dict[str, str]:
    """Parameters of a camera as delivered, without the ``root.`` prefix, in the camera's order."""
    return {
        **_brand(profile),
        **_image(profile),
        **_guard_tour(),
        "Network.HTTP.AuthenticationPolicy": "recommended",
        **_properties(profile),
        **_ptz(profile),
        "System.PreventDoSAttack.ActivatePasswordThrottling": "on",
        "System.PreventDoSAttack.DoSBlockingPeriod": "10",
        "System.PreventDoSAttack.DoSPageCount": "20",
        "System.PreventDoSAttack.DoSPageInterval": "1",
    }


def _brand(profile: Profile) -> dict[str, str]:
    return {
        "Brand.Brand": "AXIS",
        "Brand.ProdFullName": profile.full_name,
        "Brand.ProdNbr": profile.product,
        "Brand.ProdShortName": f"AXIS {profile.product}",
        "Brand.ProdType": "PTZ Network Camera",
        "Brand.ProdVariant": "",
        "Brand.WebURL": "http://www.axis.com",
    }


def _image(profile: Profile) -> dict[str, str]:
    return {
        "Image.DateFormat": "YYYY-MM-DD",
        "Image.MaxViewers": "20",
        "Image.NbrOfConfigs": "1",
        "Image.RFCCompliantMultipartEnabled": "yes",
        "Image.TriggerDataEnabled": "no",
        "Image.I0.Enabled": "yes",
        "Image.I0.Name": "View Area 1",
        "Image.I0.Source": "0",
        "Image.I0.Appearance.ColorEnabled": "yes",
        "Image.I0.Appearance.Compression": "30",
        "Image.I0.Appearance.MirrorEnabled": "no",
        "Image.I0.Appearance.Resolution": profile.resolutions[0],
        "Image.I0.Appearance.Rotation": "0",
        "Image.I0.Stream.Duration": "0",
        "Image.I0.Stream.FPS": "0",
        "Image.I0.Stream.NbrOfFrames": "0",
        "ImageSource.NbrOfSources": "1",
    }


def _guard_tour() -> dict[str, str]:
    """One guard tour over the first two presets, not running."""
    tour = "GuardTour.G0"
    steps = {}
    for number in range(2):
        steps[f"{tour}.Tour.T{number}.MoveSpeed"] = "70"
        steps[f"{tour}.Tour.T{number}.Position"] = str(number + 1)
        steps[f"{tour}.Tour.T{number}.PresetNbr"] = str(number + 1)
        steps[f"{tour}.Tour.T{number}.WaitTime"] = "10"
        steps[f"{tour}.Tour.T{number}.WaitTimeViewType"] = "Seconds"
    return {
        f"{tour}.CamNbr": "1",
        f"{tour}.Name": "Guard tour 1",
        f"{tour}.RandomEnabled": "no",
        f"{tour}.Running": "no",
        f"{tour}.TimeBetweenSequences": "1",
        **steps,
    }


def _properties(profile: Profile) -> dict[str, str]:
    return {
        "Properties.API.HTTP.AdminPath": "/",
        "Properties.API.HTTP.Version": "3",
        "Properties.API.Metadata.Metadata": "yes",
        "Properties.API.Metadata.Version": "1.0",
        "Properties.API.OnScreenControls.OnScreenControls": "yes",
        "Properties.API.PTZ.Presets.Version": "2.00",
        "Properties.API.RTSP.RTSPAuth": "yes",
        "Properties.API.RTSP.Version": "2.01",
        "Properties.API.WebService.WebService": "yes",
        "Properties.API.WebService.ONVIF.ONVIF": "yes",
        "Properties.API.WebService.ONVIF.Version": "1.02",
        "Properties.API.WebSocket.RTSP.RTSP": "yes",
        "Properties.ApiDiscovery.ApiDiscovery": "yes",
        "Properties.EmbeddedDevelopment.EmbeddedDevelopment": "yes",
        "Properties.EmbeddedDevelopment.Version": "2.16",
        "Properties.Firmware.BuildDate": "Jun 08 2021 10:17",
        "Properties.Firmware.BuildNumber": "26",
        "Properties.Firmware.Version": profile.firmware,
        "Properties.GuardTour.GuardTour": "yes",
        "Properties.HTTPS.HTTPS": "yes",
        "Properties.Image.Format": "jpeg,mjpeg,h264",
        "Properties.Image.NbrOfViews": "1",
        "Properties.Image.Resolution": ",".join(profile.resolutions),
        "Properties.Image.Rotation": "0,180",
        "Properties.PTZ.DigitalPTZ": "no",
        "Properties.PTZ.DriverManagement": "no",
        "Properties.PTZ.DriverModeList": "none",
        "Properties.PTZ.PTZ": "yes",
        "Properties.PTZ.SelectableDriverMode": "no",
        "Properties.System.Architecture": "armv7hf",
        "Properties.System.HardwareID": "7C9.2",
        "Properties.System.Language": "English",
        "Properties.System.LanguageType": "default",
        "Properties.System.SerialNumber": profile.serial,
        "Properties.System.Soc": "Axis Artpec-6",
    }


def _ptz(profile: Profile) -> dict[str, str]:
    return {
        "PTZ.BoaProtPTZOperator": "password",
        "PTZ.CameraDefault": "1",
        "PTZ.NbrOfCameras": "1",
        "PTZ.NbrOfSerPorts": "1",
        "PTZ.ResponseEncoding": "utf-8",
        "PTZ.CamPorts.Cam1Port": "1",
        "PTZ.ImageSource.I0.PTZEnabled": "true",
        **{f"PTZ.Limit.L1.{key}": value for key, value in sorted(limits(profile).items())},
        "PTZ.Preset.P0.HomePosition": "1",
        "PTZ.Preset.P0.ImageSource": "0",
        "PTZ.Preset.P0.Name": "",
        "PTZ.PTZDriverStatuses.Driver1Status": "3",
        "PTZ.SerDriverStatuses.Ser1Status": "3",
        **{f"PTZ.Support.S1.{key}": str(value).lower() for key, value in _SUPPORT},
        **_ptz_user(profile),
        **_ptz_various(),
    }


def _ptz_user(profile: Profile) -> dict[str, str]:
    queue = {}
    for number, (group, priority, timeout, kind) in enumerate(_QUEUE):
        path = f"PTZ.UserCtlQueue.U{number}"
        queue[f"{path}.Priority"] = str(priority)
        queue[f"{path}.TimeoutTime"] = str(timeout)
        queue[f"{path}.TimeoutType"] = kind
        queue[f"{path}.UseCookie"] = "yes" if number < 3 else "no"
        queue[f"{path}.UserGroup"] = group
    return {
        "PTZ.UserAdv.U1.AdjustableZoomSpeedEnabled": "true",
        "PTZ.UserAdv.U1.AutoFlip": "false",
        "PTZ.UserAdv.U1.CameraHousingConfiguration": "inverted" if profile.reversed_mount else "default",
        "PTZ.UserAdv.U1.DeviceModVer": "model:0467, version:0310",
        "PTZ.UserAdv.U1.DeviceStatus": "cam=ok,pan=ok,tilt=ok",
        "PTZ.UserAdv.U1.ImageFreeze": "off",
        "PTZ.UserAdv.U1.LastTestDate": "Thu Oct 29 08:12:04 2020",
        "PTZ.UserAdv.U1.MoveSpeed": "100",
        "PTZ.UserAdv.U1.WhiteBalanceOnePushModeEnabled": "true",
        **queue,
    }


def _ptz_various() -> dict[str, str]:
    flags = ("BackLight", "Brightness", "Focus", "IrCutFilter", "Iris", "Pan", "SpeedCtl", "Tilt", "Zoom")
    return {
        "PTZ.Various.V1.AutoFocus": "true",
        "PTZ.Various.V1.AutoIris": "true",
        "PTZ.Various.V1.BackLight": "false",
        "PTZ.Various.V1.CtlQueueing": "false",
        "PTZ.Various.V1.CtlQueueLimit": "20",
        "PTZ.Various.V1.CtlQueuePollTime": "20",
        "PTZ.Various.V1.HomePresetSet": "true",
        "PTZ.Various.V1.IrCutFilter": "auto",
        "PTZ.Various.V1.Locked": "false",
        "PTZ.Various.V1.MaxProportionalSpeed": "200",
        "PTZ.Various.V1.ProportionalSpeedEnabled": "true",
        "PTZ.Various.V1.PTZCounter": "8",
        "PTZ.Various.V1.ReturnToOverview": "0",
        **{f"PTZ.Various.V1.{flag}Enabled": "true" for flag in flags},
    }


def limits(profile: Profile, *, e_flip_tilt_deg: float | None = None) -> dict[str, str]:
    """Limits of ``query=limits``; ``e_flip_tilt_deg`` replaces the lower tilt limit of a camera with E-flip."""
    low_tilt = profile.tilt.low if e_flip_tilt_deg is None else e_flip_tilt_deg
    values = {
        "MinPan": f"{profile.pan.low:g}",
        "MaxPan": f"{profile.pan.high:g}",
        "MinTilt": f"{low_tilt:g}",
        "MaxTilt": f"{profile.tilt.high:g}",
        "MinZoom": "1",
        "MaxZoom": f"{profile.zoom.high:g}",
    }
    if "iris" in profile.position_keys:
        values |= {"MinIris": "1", "MaxIris": "9999"}
    if "focus" in profile.position_keys:
        values |= {"MinFocus": "770", "MaxFocus": "9999"}
    values |= {"MinFieldAngle": str(profile.field_angle[0]), "MaxFieldAngle": str(profile.field_angle[1])}
    if "brightness" in profile.position_keys:
        values |= {"MinBrightness": "1", "MaxBrightness": "9999"}
    return values


def select(parameters: dict[str, str], groups: str, role: Role) -> tuple[list[str], list[str]]:
    """Lines ``root.Name=value`` of the comma-separated groups, and the groups that do not exist for this role.

    A group is a name or a prefix of names, with or without ``root.``, and may hold ``*``; no group means everything.
    """
    visible = {
        name: value
        for name, value in parameters.items()
        if role > Role.VIEWER or name.split(".", 1)[0] in VIEWER_GROUPS
    }
    lines: list[str] = []
    unknown: list[str] = []
    for group in groups.split(",") if groups else ["*"]:
        bare = group.strip().removeprefix("root.").rstrip(".")
        bare = "*" if bare == "root" else bare
        found = [f"root.{name}={value}" for name, value in visible.items() if _matches(name, bare)]
        if found:
            lines += found
        else:
            unknown.append(bare)
    return lines, unknown


def _matches(name: str, group: str) -> bool:
    return name == group or name.startswith(f"{group}.") or fnmatch.fnmatchcase(name, group) or (
        "*" in group and fnmatch.fnmatchcase(name, f"{group}.*")
    )  # fmt: skip
