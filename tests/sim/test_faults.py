from ptzd.sim.faults import Fault, FaultBox, FaultKind


def test_a_fault_hits_its_path_in_its_time_and_no_more_often_than_counted():
    box = FaultBox()
    box.add(Fault(kind=FaultKind.STATUS, at_s=1.0, for_s=2.0, count=2, path="*speed*"), now_s=10.0)
    assert box.on_request("/a?query=speed", 10.9) is None
    assert box.on_request("/a?query=limits", 11.5) is None
    assert box.on_request("/a?query=speed", 11.5) is not None
    assert box.on_picture("/a?query=speed", 11.5) is None
    assert box.on_request("/a?query=speed", 11.6) is not None
    assert box.on_request("/a?query=speed", 11.7) is None


def test_a_fault_ends_after_its_time_or_when_cleared():
    box = FaultBox()
    short, lasting = Fault(kind=FaultKind.SLOW, for_s=1.0), Fault(kind=FaultKind.RESET)
    box.add(short, 0.0)
    assert box.on_request("/", 0.5) is short
    assert box.on_request("/", 1.0) is None
    with box.during(lasting, 2.0):
        assert box.on_request("/", 9.0) is lasting
    assert box.on_request("/", 9.0) is None


def test_what_happens_once_is_due_once():
    box = FaultBox()
    box.add(Fault(kind=FaultKind.REBOOT, at_s=3.0), 0.0)
    assert box.due(2.9) == []
    assert box.on_request("/", 3.0) is None
    assert [fault.kind for fault in box.due(3.0)] == [FaultKind.REBOOT]
    assert box.due(3.1) == []
