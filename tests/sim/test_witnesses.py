"""Clients that were not written here drive the simulated camera and cannot tell."""

import asyncio
import importlib.util
import json
import shutil
import sys
import textwrap

import pytest

needs_axis = pytest.mark.skipif(
    importlib.util.find_spec("axis") is None, reason="package axis is not installed: pip install 'ptzd[dev]'"
)
needs_sensecam = pytest.mark.skipif(
    importlib.util.find_spec("sensecam_control") is None,
    reason="package sensecam-control is not installed: pip install 'ptzd[dev]'",
)
needs_curl = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")

LOGIN = "ptzd:pan-tilt-zoom"


async def run(*command: str, cwd: object = None) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        *command, cwd=cwd, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    output, _ = await asyncio.wait_for(process.communicate(), 250)
    return process.returncode, output.decode()


async def python(source: str, cwd: object, *arguments: str) -> str:
    code, output = await run(sys.executable, "-c", textwrap.dedent(source), *arguments, cwd=cwd)
    assert code == 0, output
    return output


@needs_axis
async def test_the_package_axis_reads_and_drives_it(start, tmp_path):
    visitor = await start(rate=5.0)
    script = """
        import asyncio, json, sys
        import httpx
        from axis.device import AxisDevice
        from axis.models.configuration import Configuration
        from axis.models.ptz_cgi import PtzMove, PtzQuery

        async def main(port):
            async with httpx.AsyncClient() as session:
                login = {"username": "ptzd", "password": "pan-tilt-zoom"}
                device = AxisDevice(Configuration(session, "127.0.0.1", port=port, **login))
                vapix = device.vapix
                await vapix.initialize()
                ptz = vapix.params.ptz_handler["0"]
                await vapix.ptz.control(pan=10.5, tilt=-5, zoom=700, speed=60)
                await asyncio.sleep(0.7)
                position = (await vapix.ptz.query(PtzQuery.POSITION)).decode()
                limits = (await vapix.ptz.query(PtzQuery.LIMITS)).decode()
                driver = (await vapix.ptz.configured_device_driver()).decode()
                commands = (await vapix.ptz.available_ptz_commands()).decode()
                await vapix.ptz.control(continuous_pantilt_move=(30, 0))
                await asyncio.sleep(0.4)
                await vapix.ptz.control(move=PtzMove.STOP)
                await asyncio.sleep(0.4)
                stopped = (await vapix.ptz.query(PtzQuery.POSITION)).decode()
                print(json.dumps({
                    "product": vapix.product_number, "firmware": vapix.firmware_version, "serial": vapix.serial_number,
                    "rights": str(vapix.access_rights), "limits": [ptz.limits["1"].min_pan, ptz.limits["1"].max_tilt],
                    "support": ptz.support["1"].absolute_pan, "position": position, "query": limits, "driver": driver,
                    "commands": commands.splitlines()[0], "stopped": stopped,
                }))

        asyncio.run(main(int(sys.argv[1])))
    """
    told = json.loads((await python(script, tmp_path, str(visitor.rig.camera.port))).splitlines()[-1])
    assert told["product"] == "V5915"
    assert told["firmware"] == "10.12.91"
    assert told["serial"] == visitor.rig.profile.serial
    assert told["limits"] == [-170, 90]
    assert told["support"] is True
    assert told["position"].splitlines()[:3] == ["pan=10.5000", "tilt=-5.0000", "zoom=700"]
    assert "MaxFieldAngle=623" in told["query"]
    assert told["driver"].strip() == "Sony_camblock"
    assert told["commands"] == "Available commands"
    pan = float(told["stopped"].splitlines()[0].removeprefix("pan="))
    assert pan > 10.5
    assert (await visitor.position())["pan"] == pan


@needs_sensecam
async def test_the_package_sensecam_control_drives_it(start, tmp_path):
    visitor = await start(rate=5.0)
    script = """
        import sys, time
        from sensecam_control import vapix_config, vapix_control

        address = f"127.0.0.1:{sys.argv[1]}"
        camera = vapix_control.CameraControl(address, "ptzd", "pan-tilt-zoom")
        camera.absolute_move(25, 10, 500, 90)
        time.sleep(0.7)
        print(camera.get_ptz())
        camera.relative_move(-5, 2.5, None, None)
        time.sleep(0.5)
        print(camera.get_ptz())
        camera.continuous_move(50, -20, 0)
        time.sleep(0.3)
        camera.stop_move()
        time.sleep(0.4)
        print(camera.get_speed().text if hasattr(camera.get_speed(), "text") else camera.get_speed())
        camera.go_home_position(100)
        time.sleep(0.8)
        print(camera.get_ptz())
        print(vapix_config.CameraConfiguration(address, "ptzd", "pan-tilt-zoom").get_image_size())
    """
    output = await python(script, tmp_path, str(visitor.rig.camera.port))
    lines = output.splitlines()
    assert lines[0] == "(25.0, 10.0, 500.0)", output
    assert lines[1] == "(20.0, 12.5, 500.0)", output
    assert "(0.0, 0.0, 1.0)" in lines, output
    sources = {order.source for order in visitor.rig.camera.unit.orders}
    assert sources == {"ptzd"}


@needs_curl
async def test_curl_gets_position_picture_and_stream_with_digest(visitor, tmp_path):
    base, login = visitor.rig.camera_url, ("--silent", "--show-error", "--digest", "--user", LOGIN)
    code, text = await run("curl", *login, f"{base}/axis-cgi/com/ptz.cgi?query=position")
    assert code == 0
    assert text.startswith("pan=0.0000\r\ntilt=")
    code, text = await run("curl", *login, "-i", f"{base}/axis-cgi/com/ptz.cgi?pan=3&tilt=1")
    assert "204 No Content" in text
    picture = tmp_path / "still.jpg"
    await run("curl", *login, "-o", str(picture), f"{base}/axis-cgi/jpg/image.cgi?resolution=320x240")
    assert picture.read_bytes()[:2] == b"\xff\xd8"
    stream = tmp_path / "stream.mjpg"
    url = f"{base}/axis-cgi/mjpg/video.cgi?resolution=320x240&fps=20&nbrofframes=5"
    code, text = await run("curl", *login, "-o", str(stream), url)
    assert code == 0, text
    assert stream.read_bytes().count(b"--myboundary\r\nContent-Type: image/jpeg\r\n") == 5


@needs_curl
async def test_curl_over_https_uses_basic(start):
    visitor = await start(https=True)
    url = f"{visitor.rig.camera.https_url}/axis-cgi/com/ptz.cgi?query=speed"
    code, text = await run("curl", "--silent", "--insecure", "--anyauth", "--user", LOGIN, url)
    assert (code, text.strip()) == (0, "speed=100")


@needs_ffmpeg
@pytest.mark.parametrize("fisheye", [False, True])
async def test_ffmpeg_reads_the_streams(start, tmp_path, fisheye):
    visitor = await start(fisheye_fps=20.0)
    path = "/axis-cgi/mjpg/video.cgi?resolution=320x240&fps=20&compression=20"
    camera = visitor.rig.camera_url.replace("http://", f"http://{LOGIN}@") + path
    url = visitor.rig.fisheye_url if fisheye else camera
    log = "-hide_banner", "-loglevel", "error"
    code, text = await run(
        "ffmpeg",
        *log,
        "-f",
        "mpjpeg",
        "-i",
        url,
        "-frames:v",
        "6",
        "-fps_mode",
        "passthrough",
        "frame%d.png",
        cwd=tmp_path,
    )
    assert code == 0, text
    assert len(list(tmp_path.glob("frame*.png"))) == 6
