"""The outside world over Zenoh: messages, the daemon's end (``server``) and the apps' end (``client``).

What comes in at the daemon's end waits twice, each time bounded: in the ``mailbox`` of its ``arrivals``, where it goes
from Zenoh's threads to the loop, and, when the core is to decide, in the ``event_queue``, where an operator's word
overtakes what waits and of the updates only the newest stays. Between both, ``core_handlers`` make events of it; what
the bus knows by itself it ``answers``. ``pending_queries`` wait for what the core answers, ``replies`` sends it from
threads of its own, ``results`` are kept for those who ask late.

The apps' end is ``asking``, ``listening`` to everybody, ``following`` one request, ``leasing`` the head.
"""
