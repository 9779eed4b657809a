"""What goes wrong between HTTP and an answer, as the daemon's errors."""

from __future__ import annotations

import logging
import ssl
from types import TracebackType

import aiohttp

from ptzd.errors import DeviceError, DeviceGarbled, DeviceLost, DeviceRefused

PACKED = "content-encoding"
UNPACKED = "that is not read here; switch compression (Content-Encoding) off in the camera or the proxy that does so"
LOGGER = logging.getLogger(__name__)


class ConnectionCut(DeviceLost):
    """The connection broke before the answer was complete."""


class Overloaded(DeviceLost):
    """The camera is starting or serves as many as it can (503).

    Attributes
    ----------
    retry_after_s : float or None
        When the camera wants to be asked again.
    """

    def __init__(self, message: str, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class PageFails(DeviceLost):
    """The camera answers with an error of its own (5xx other than 503)."""


class NotOffered(DeviceRefused):
    """The camera does not have this page or does not take this method (404, 405)."""


class RefusedAccess(DeviceRefused):
    """The password or a right is refused; the message already names the page where that was found out."""


class Forbidden(RefusedAccess):
    """The account is known but has no right to this page (403)."""


class FailuresNamed:
    """Turns what aiohttp raises into the daemon's errors and puts camera and page in front of each message.

    The cause is cut off on purpose: aiohttp's exceptions carry the request's headers, and those the authorization.

    Parameters
    ----------
    place : str
        Camera and page.
    setting : str
        Part of the settings, for messages.
    """

    def __init__(self, place: str, setting: str) -> None:
        self._place = place
        self._setting = setting

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, RefusedAccess):
            return
        if isinstance(error, DeviceError):
            error.args = (f"{self._place}: {error}",)
        elif isinstance(error, aiohttp.ServerFingerprintMismatch | aiohttp.ClientSSLError | ssl.SSLError):
            raise self._untrusted(error) from None
        elif isinstance(error, aiohttp.ClientError | TimeoutError | OSError):
            raise self._unanswered(error) from None
        elif isinstance(error, ValueError):
            # headers, addresses and texts of the answer are turned into values in there: it is the answer that is odd
            LOGGER.debug("%s: an answer that raised %r", self._place, error)
            raise DeviceGarbled(f"{self._place}: an answer that cannot be understood") from None

    def _untrusted(self, error: Exception) -> DeviceError:
        if isinstance(error, aiohttp.ServerFingerprintMismatch):
            return DeviceRefused(
                f"{self._place}: shows certificate {error.got.hex()} instead of {self._setting}.certificate_sha256; "
                "if it was renewed, compare it at the camera and change the setting"
            )
        if isinstance(error, aiohttp.ClientConnectorCertificateError):
            reason = getattr(error.certificate_error, "verify_message", None) or "it does not say why"
            return DeviceRefused(
                f"{self._place}: certificate not trusted ({reason}); "
                f"set {self._setting}.certificate_sha256 to the fingerprint shown in the camera"
            )
        return DeviceLost(f"{self._place}: no TLS connection; check whether {self._setting}.url is http or https")

    def _unanswered(self, error: Exception) -> DeviceError:
        if isinstance(error, TimeoutError):
            return DeviceLost(f"{self._place}: no answer in time")
        if isinstance(error, aiohttp.ClientConnectorError):
            return DeviceLost(f"{self._place}: cannot connect ({error.os_error.strerror or error.os_error})")
        LOGGER.debug("%s: %r", self._place, type(error))
        # aiohttp has no class for a packing that it cannot undo; told with the headers, or while the body is read
        if PACKED in str(error) or getattr(error, "message", "") in {"deflate", "gzip"}:
            return DeviceGarbled(f"{self._place}: the answer is compressed in a way {UNPACKED}")
        if isinstance(error, aiohttp.InvalidURL):
            return DeviceGarbled(f"{self._place}: leads to an address that is none")
        if isinstance(error, aiohttp.ClientResponseError):
            return DeviceGarbled(f"{self._place}: not an HTTP answer")
        return ConnectionCut(f"{self._place}: connection cut ({_how(error)})")


def _how(error: Exception) -> str:
    """How far it came, in words."""
    if isinstance(error, aiohttp.ServerDisconnectedError):
        return "before an answer"
    if isinstance(error, aiohttp.ClientPayloadError):
        return "in the middle of the answer"
    reason = getattr(error, "strerror", None)
    return reason.lower() if isinstance(reason, str) and reason else "by the camera or the network"
