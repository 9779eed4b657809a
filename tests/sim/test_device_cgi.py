import json
from pathlib import Path

import pytest

from ptzd.sim.auth import Role, User
from ptzd.sim.device_cgi import api_discovery, basic_device_info, properties, system_ready, user_groups
from ptzd.sim.profile import profile

RECORDED = Path(__file__).parents[1] / "data" / "axis_http"
USER = User(name="ptzd", password="x")
KIND = profile("v5915")


def ask(method: str, **more: object) -> dict[str, object]:
    return {"apiVersion": "1.0", "context": "c", "method": method, **more}


def test_the_property_list_has_the_recorded_names():
    recorded = json.loads((RECORDED / "basic_device_info__GET_ALL_PROPERTIES_RESPONSE.json").read_text())
    assert set(recorded["data"]["propertyList"]) == set(properties(KIND))


def test_a_stranger_learns_only_what_is_unrestricted():
    seen = basic_device_info(KIND, ask("getAllUnrestrictedProperties"), None)["data"]["propertyList"]
    assert seen["ProdNbr"] == "V5915"
    assert "Soc" not in seen
    assert "error" in basic_device_info(KIND, ask("getAllProperties"), None)
    assert "Soc" in basic_device_info(KIND, ask("getAllProperties"), USER)["data"]["propertyList"]


def test_single_properties_can_be_asked_for():
    wanted = ask("getProperties", params={"propertyList": ["Version", "Nonsense"]})
    assert basic_device_info(KIND, wanted, USER)["data"]["propertyList"] == {"Version": KIND.firmware}


@pytest.mark.parametrize("answer", [
    lambda message: basic_device_info(KIND, message, USER), api_discovery,
    lambda message: system_ready(message, ready=True, uptime_s=5.5, boot_id="b"),
])  # fmt: skip
def test_every_json_api_gives_the_context_back_and_refuses_unknown_methods(answer):
    assert answer(ask("getSupportedVersions"))["context"] == "c"
    assert "context" not in answer({"method": "getSupportedVersions"})
    refused = answer(ask("getNonsense"))
    assert refused["error"]["code"] == 2004
    assert refused["context"] == "c"


def test_discovery_has_the_recorded_form_and_tells_of_the_ptz():
    recorded = json.loads((RECORDED / "api_discovery__GET_API_LIST_RESPONSE.json").read_text())
    apis = api_discovery(ask("getApiList"))["data"]["apiList"]
    assert set(apis[0]) == set(recorded["data"]["apiList"][0])
    assert "ptz-control" in {api["id"] for api in apis}


def test_readiness_is_told_while_booting_and_after():
    states = [
        system_ready(ask("systemready"), ready=ready, uptime_s=5.5, boot_id="b")["data"] for ready in (False, True)
    ]
    assert [state["systemready"] for state in states] == ["no", "yes"]
    assert states[1]["uptime"] == "5"


def test_groups_of_each_role():
    assert user_groups(User(name="v", password="x", role=Role.VIEWER, ptz=False)) == "v\r\nviewer\r\n"
    assert user_groups(User(name="a", password="x", role=Role.ADMINISTRATOR)) == "a\r\nadmin operator viewer ptz\r\n"
