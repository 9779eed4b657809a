import base64
import hashlib

import pytest

from ptzd.sim.auth import BLOCK_S, FAILURES_PER_S, Gate, Policy, Role, User, Verdict

USER = User(name="ptzd", password="grün", role=Role.OPERATOR)
TARGET = "/axis-cgi/com/ptz.cgi?query=position"


def gate(**changes: object) -> Gate:
    return Gate((USER,), realm="AXIS_ACCC8E5915A1", secret=b"s", **{"policy": Policy.BASIC_DIGEST, **changes})


def md5(text: str) -> str:
    return hashlib.md5(text.encode()).hexdigest()


def digest(nonce: str, *, password: str = "grün", uri: str = TARGET, method: str = "GET", qop: bool = True) -> str:
    ha1, ha2 = md5(f"ptzd:AXIS_ACCC8E5915A1:{password}"), md5(f"{method}:{uri}")
    response = md5(f"{ha1}:{nonce}:00000001:c1:auth:{ha2}") if qop else md5(f"{ha1}:{nonce}:{ha2}")
    tail = ', qop=auth, nc=00000001, cnonce="c1"' if qop else ""
    return (
        f'Digest username="ptzd", realm="AXIS_ACCC8E5915A1", nonce="{nonce}", uri="{uri}", response="{response}"{tail}'
    )


def basic(password: str = "grün") -> str:
    return "Basic " + base64.b64encode(f"ptzd:{password}".encode()).decode()


def ask(door: Gate, t_s: float, authorization: str | None, *, secure: bool = False, target: str = TARGET) -> Verdict:
    return door.check(t_s, method="GET", target=target, authorization=authorization, secure=secure)


@pytest.mark.parametrize("qop", [True, False])
def test_a_right_digest_lets_in(qop):
    door = gate()
    assert ask(door, 1.0, digest(door.nonce(0.5), qop=qop)).user == USER


@pytest.mark.parametrize(
    "wrong",
    [{"password": "x"}, {"uri": "/axis-cgi/com/ptz.cgi?pan=1"}, {"method": "POST"}],
)
def test_a_wrong_password_target_or_method_does_not(wrong):
    door = gate()
    verdict = ask(door, 1.0, digest(door.nonce(0.5), **wrong))
    assert verdict.user is None
    assert verdict.wrong
    assert "stale" not in " ".join(verdict.challenges)


def test_an_old_nonce_is_answered_with_stale_and_costs_nothing():
    door = gate(nonce_life_s=10.0)
    verdict = ask(door, 20.1, digest(door.nonce(10.0)))
    assert verdict.user is None
    assert not verdict.wrong
    assert any("stale=true" in line for line in verdict.challenges)


def test_a_restart_makes_every_nonce_stale():
    door = gate()
    nonce = door.nonce(1.0)
    door.forget_nonces()
    assert any("stale=true" in line for line in ask(door, 1.1, digest(nonce)).challenges)


@pytest.mark.parametrize(("policy", "secure", "schemes"), [
    (Policy.RECOMMENDED, False, ["Digest"]),
    (Policy.RECOMMENDED, True, ["Basic"]),
    (Policy.BASIC, False, ["Basic"]),
    (Policy.DIGEST, True, ["Digest"]),
    (Policy.BASIC_DIGEST, False, ["Digest", "Basic"]),
])  # fmt: skip
def test_the_policy_says_what_is_offered(policy, secure, schemes):
    offered = ask(gate(policy=policy), 1.0, None, secure=secure).challenges
    assert [line.split()[0] for line in offered] == schemes


def test_the_order_of_the_challenges_can_be_turned():
    assert [line.split()[0] for line in ask(gate(basic_first=True), 1.0, None).challenges] == ["Basic", "Digest"]


def test_a_digest_is_refused_where_only_basic_is_offered():
    door = gate(policy=Policy.RECOMMENDED)
    assert ask(door, 1.0, digest(door.nonce(0.5)), secure=True).user is None
    assert ask(door, 1.0, basic(), secure=True).user == USER


def test_challenges_have_the_recorded_forms():
    (new,) = ask(gate(policy=Policy.DIGEST), 1.0, None).challenges
    assert new.startswith('Digest realm="AXIS_ACCC8E5915A1", nonce="')
    assert new.endswith('", algorithm=MD5, qop="auth"')
    (old,) = ask(gate(policy=Policy.DIGEST, old_style=True), 1.0, None).challenges
    assert old.endswith('", stale=FALSE, qop="auth"')


@pytest.mark.parametrize("header", ["Basic ???", "Basic /w==", "Digest", "Digest username=", "Bearer x", ""])
def test_a_malformed_header_is_only_a_refusal(header):
    assert ask(gate(), 1.0, header).user is None


def test_too_many_failures_close_the_door_for_everybody_for_a_while():
    door = gate()
    for _ in range(FAILURES_PER_S + 1):
        assert not ask(door, 5.0, basic("wrong")).blocked
    assert ask(door, 5.5, basic()).blocked
    assert ask(door, 5.0 + BLOCK_S + 0.1, basic()).user == USER


def test_slow_failures_and_bare_challenges_never_close_it():
    door = gate()
    for number in range(100):
        assert not ask(door, 0.1 * number, basic("wrong")).blocked
        assert not ask(door, 0.1 * number, None).blocked


def test_no_repr_shows_a_password():
    assert "grün" not in repr(USER)
