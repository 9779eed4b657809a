from __future__ import annotations

import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices.vapix.auth import Authenticator, Challenge, digest_header, parse_challenges
from ptzd.devices.vapix.credentials import Credentials, Secret
from ptzd.errors import DeviceRefused

DIGEST = 'Digest realm="AXIS_ACCC8EF7DE6B", nonce="{}", algorithm=MD5, qop="auth"'
BASIC = 'Basic realm="AXIS_ACCC8EF7DE6B"'
CREDENTIALS = Credentials(user="root", password=Secret("s3cret"))


def authenticator(*, basic_allowed: bool = False, credentials=CREDENTIALS) -> Authenticator:
    return Authenticator(credentials, basic_allowed=basic_allowed, setting="ptz", cnonce=lambda: "c0ffee")


@pytest.mark.parametrize(
    ("algorithm", "response"),
    [
        ("MD5", "8ca523f5e9506fed4657c9700eebdbec"),
        ("SHA-256", "753927fa0e85d155564e2e272a28d1802ca10daf4496794697cf8db5856cb6c1"),
    ],
)
def test_the_example_of_rfc_7616(algorithm, response):
    nonce = "7ypf/xlj9XXwfDPEoM4URrv/xwf94BcCAzFZH4GiTo0v"
    parameters = {"realm": "http-auth@example.org", "nonce": nonce, "qop": "auth, auth-int", "algorithm": algorithm}
    header = digest_header(
        Credentials(user="Mufasa", password=Secret("Circle of Life")),
        Challenge(scheme="digest", parameters=parameters | {"opaque": "FQhe/qaU925kfnzjCev0ciny7QMkPqMAFRtzCUYo5tdS"}),
        method="GET",
        target="/dir/index.html",
        count=1,
        cnonce="f2/wE4q74E6zIJEtWaHKaf5wv/H5QzzpXusqGemxURZJ",
    )
    assert f'response="{response}"' in header
    assert "qop=auth, nc=00000001" in header
    assert 'opaque="FQhe/qaU925kfnzjCev0ciny7QMkPqMAFRtzCUYo5tdS"' in header


def test_the_old_form_without_quality_of_protection():
    # RFC 2069: response = H(H(A1):nonce:H(A2)), with the value of its erratum 749.
    parameters = {"realm": "testrealm@host.com", "nonce": "dcd98b7102dd2f0e8b11d0f600bfb0c093"}
    header = digest_header(
        Credentials(user="Mufasa", password=Secret("CircleOfLife")),
        Challenge(scheme="digest", parameters=parameters),
        method="GET", target="/dir/index.html", count=1, cnonce="x",
    )  # fmt: skip
    assert 'response="1949323746fe6a43ef61f9606e7febea"' in header
    assert "nc=" not in header


def test_challenges_of_several_headers_and_of_one_header():
    one = parse_challenges([DIGEST.format("a,b=") + ", " + BASIC])
    two = parse_challenges([DIGEST.format("a,b="), BASIC])
    assert one == two
    assert [challenge.scheme for challenge in one] == ["digest", "basic"]
    assert one[0].parameters["nonce"] == "a,b="


@given(st.lists(st.text(max_size=60), max_size=4))
def test_any_header_is_parsed_without_a_crash(values):
    for challenge in parse_challenges(values):
        assert challenge.algorithm is not None


@pytest.mark.parametrize("headers", [[DIGEST.format("n"), BASIC], [BASIC, DIGEST.format("n")]])
def test_digest_is_chosen_in_either_order(headers):
    auth = authenticator(basic_allowed=True)
    auth.challenged(None, headers)
    assert auth.attempt("GET", "/x").value.startswith('Digest username="root"')


def test_the_stronger_hash_is_chosen():
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n"), DIGEST.format("m").replace("MD5", "SHA-256")])
    assert "algorithm=SHA-256" in auth.attempt("GET", "/x").value


def test_an_unknown_hash_is_passed_over():
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n").replace("MD5", "SHA-512-256"), DIGEST.format("m")])
    assert 'nonce="m"' in auth.attempt("GET", "/x").value


def test_the_count_of_a_nonce_rises():
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n")])
    values = [auth.attempt("GET", "/x").value for _ in range(3)]
    assert ["nc=00000001" in values[0], "nc=00000002" in values[1], "nc=00000003" in values[2]] == [True] * 3


def test_basic_needs_tls_or_a_word():
    with pytest.raises(DeviceRefused, match="allow_basic_over_http"):
        authenticator().challenged(None, [BASIC])
    auth = authenticator(basic_allowed=True)
    auth.challenged(None, [BASIC])
    assert auth.attempt("GET", "/").value == "Basic " + base64.b64encode(b"root:s3cret").decode()


def test_a_password_is_tried_once_on_a_fresh_nonce():
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n")])
    with pytest.raises(DeviceRefused, match=r"user 'root' or the password is refused"):
        auth.challenged(auth.attempt("GET", "/"), [DIGEST.format("m")])


@pytest.mark.parametrize("tail", [", stale=true", ""])
def test_an_expired_nonce_is_renewed(tail):
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n")])
    auth.accepted(auth.attempt("GET", "/"))
    auth.challenged(auth.attempt("GET", "/"), [DIGEST.format("m") + tail])
    assert 'nonce="m"' in auth.attempt("GET", "/").value


def test_a_nonce_renewed_by_another_request_is_used():
    auth = authenticator()
    auth.challenged(None, [DIGEST.format("n")])
    slow, quick = auth.attempt("GET", "/slow"), auth.attempt("GET", "/quick")
    auth.accepted(quick)
    auth.challenged(quick, [DIGEST.format("m") + ", stale=true"])
    auth.challenged(slow, [DIGEST.format("o") + ", stale=true"])
    assert 'nonce="m"' in auth.attempt("GET", "/").value


def test_without_credentials_a_challenge_names_the_setting():
    with pytest.raises(DeviceRefused, match=r"set ptz\.user"):
        authenticator(credentials=None).challenged(None, [BASIC])


@pytest.mark.parametrize("headers", [[], ["Bearer x"], ["Digest qop=auth-int, nonce=a"], ["Digest realm=x"]])
def test_nothing_usable_is_said(headers):
    with pytest.raises(DeviceRefused, match="no usable authentication"):
        authenticator().challenged(None, headers)
