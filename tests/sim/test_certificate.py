import shutil
import subprocess

import pytest

from ptzd.sim.certificate import self_signed


def test_every_certificate_is_another_and_has_its_fingerprint():
    one, other = self_signed("axis-1"), self_signed("axis-1")
    assert one.sha256 != other.sha256
    assert len(one.sha256) == 64
    assert "key" not in repr(one)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl's command is not installed: no second witness")
def test_openssl_reads_it_and_finds_the_signature_right(tmp_path):
    path = tmp_path / "certificate.pem"
    path.write_text(self_signed("axis-accc8e5915a1").pem)
    shown = subprocess.run(["openssl", "x509", "-in", path, "-noout", "-text"], capture_output=True, check=True)
    assert b"CN = axis-accc8e5915a1" in shown.stdout
    assert b"IP Address:127.0.0.1" in shown.stdout
    verified = subprocess.run(["openssl", "verify", "-CAfile", path, path], capture_output=True, check=True)
    assert verified.stdout.endswith(b": OK\n")
