"""An AXIS PTZ camera over VAPIX: requests as data, one client, the head and its stream."""
