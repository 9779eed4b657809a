"""The queue refuses pictures when it is full, and nothing else."""

import threading

from ptzd.log.inbox import Cut, Inbox, Record
from ptzd.log.protobuf import CompressedImage


def record(droppable, number=0):
    return Record(topic="/event", log_ns=number, publish_ns=number, sequence=number, data=b"", droppable=droppable)


def test_only_droppable_records_are_refused():
    inbox = Inbox(2)
    assert [inbox.put(record(True, number)) for number in range(4)] == [True, True, False, False]
    assert all(inbox.put(record(False, number)) for number in range(100))
    assert inbox.take(0).droppable
    assert inbox.put(record(True)), "room again after one was taken"
    assert not inbox.put(record(True))


def test_order_is_kept():
    inbox = Inbox(8)
    items = [record(False, 1), record(True, 2), Cut(), record(False, 3)]
    for item in items:
        inbox.put(item)
    assert len(inbox) == 4
    assert [inbox.take(0) for _ in items] == items
    assert inbox.take(0) is None


def test_a_waiting_thread_wakes():
    inbox, taken = Inbox(1), []
    thread = threading.Thread(target=lambda: taken.append(inbox.take(100.0)))
    thread.start()
    inbox.put(Cut())
    thread.join(100.0)
    assert taken == [Cut()]


def test_a_picture_is_serialised_when_it_is_written():
    image = CompressedImage(t_ns=1, frame_id="f", data=b"jpeg", format="jpeg")
    item = Record(topic="/ptz/image", log_ns=1, publish_ns=1, sequence=1, data=image)
    assert b"jpeg" in item.payload()
