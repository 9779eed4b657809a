"""Recognising a region of the fisheye picture in a PTZ view: ``sweep``, the default, and ``harris``, the paper."""
