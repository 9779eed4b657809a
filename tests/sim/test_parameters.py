from pathlib import Path

import pytest

from ptzd.sim.auth import Role
from ptzd.sim.parameters import factory_parameters, limits, select
from ptzd.sim.profile import profile

RECORDED = Path(__file__).parents[1] / "data" / "axis_http"


def recorded(name: str) -> dict[str, str]:
    text = (RECORDED / name).read_text(encoding="utf-8")
    return dict(line.removeprefix("root.").split("=", 1) for line in text.splitlines() if "=" in line)


def test_a_v5915_has_every_ptz_parameter_of_the_recorded_camera_of_its_class():
    ours, theirs = factory_parameters(profile("v5915")), recorded("ptz__PTZ_RESPONSE.txt")
    names = {name for name in theirs if not name.startswith(("PTZ.Preset.", "PTZ.UserCtlQueue."))}
    assert names <= set(ours)
    same = [name for name in names if name.startswith(("PTZ.Limit.", "PTZ.Support."))]
    assert {name: ours[name] for name in same if name != "PTZ.Support.S1.DigitalZoom"} == {
        name: theirs[name] for name in same if name != "PTZ.Support.S1.DigitalZoom"
    }


def test_brand_and_properties_have_the_recorded_names():
    ours = factory_parameters(profile("v5915"))
    assert set(recorded("brand__BRAND_RESPONSE.txt")) <= set(ours)
    wanted = {name for name in recorded("properties__PROPERTY_RESPONSE.txt") if name.startswith("Properties.System.")}
    assert wanted <= set(ours)


def test_the_profile_agrees_with_its_parameters(kind):
    ours = factory_parameters(kind)
    for name, value in limits(kind).items():
        assert ours[f"PTZ.Limit.L1.{name}"] == value
    assert ours["Properties.Image.Resolution"].split(",") == list(kind.resolutions)
    assert ours["Brand.ProdNbr"] == kind.product
    assert ours["Properties.System.SerialNumber"] == kind.serial


@pytest.mark.parametrize(("groups", "count", "missing"), [
    ("Brand", 7, []), ("root.Brand", 7, []), ("Brand.Brand", 1, []), ("Brand.*", 7, []), ("*.Brand", 1, []),
    ("Brand,PTZ.CamPorts", 8, []), ("Nope,Brand", 7, ["Nope"]), ("Bra", 0, ["Bra"]), ("root.Nope", 0, ["Nope"]),
])  # fmt: skip
def test_groups_select_names(groups, count, missing):
    lines, unknown = select(factory_parameters(profile("v5915")), groups, Role.OPERATOR)
    assert (len(lines), unknown) == (count, missing)
    assert all(line.startswith("root.") for line in lines)


def test_everything_is_listed_without_a_group_and_less_of_it_to_viewers():
    everything = factory_parameters(profile("v5915"))
    assert len(select(everything, "", Role.ADMINISTRATOR)[0]) == len(everything)
    seen, _ = select(everything, "", Role.VIEWER)
    assert 0 < len(seen) < len(everything)
    assert not any(line.startswith(("root.System.", "root.Network.")) for line in seen)
