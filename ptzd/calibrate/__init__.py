"""The steps of ``ptzd calibrate``: pictures, files and logs in, parts and ``rig.yaml`` out, with what to tell a person.

The mathematics is in :mod:`ptzd.calibration`, which knows neither commands nor work folders nor cameras.
"""
