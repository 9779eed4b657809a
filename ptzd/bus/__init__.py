"""The outside world over Zenoh: messages, the daemon's end (``server``) and the apps' end (``client``)."""
