from __future__ import annotations

import ctypes
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices import v4l2_abi as abi

KERNEL_NUMBERS = {
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "S_FMT": 0xC0D05605,
    "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609,
    "QBUF": 0xC058560F,
    "DQBUF": 0xC0585611,
    "STREAMON": 0x40045612,
    "STREAMOFF": 0x40045613,
    "S_PARM": 0xC0CC5616,
    "G_CTRL": 0xC008561B,
    "S_CTRL": 0xC008561C,
    "QUERYCTRL": 0xC0445624,
    "ENUM_FRAMESIZES": 0xC02C564A,
    "ENUM_FRAMEINTERVALS": 0xC034564B,
}
KERNEL_OFFSETS = {
    (abi.Format, "fmt"): 8,
    (abi.Buffer, "timestamp"): 24,
    (abi.Buffer, "sequence"): 56,
    (abi.Buffer, "m"): 64,
    (abi.Buffer, "length"): 72,
    (abi.StreamParameters, "timeperframe"): 12,
    (abi.FrameIntervalEnum, "interval"): 20,
    (abi.FrameSizeEnum, "size"): 12,
    (abi.Capability, "device_caps"): 88,
}


@pytest.mark.parametrize("name", KERNEL_NUMBERS)
def test_requests_have_the_numbers_that_the_kernels_header_compiles_to(name):
    assert getattr(abi, name) == KERNEL_NUMBERS[name]


@pytest.mark.parametrize(("structure", "name"), KERNEL_OFFSETS)
def test_fields_lie_where_the_kernels_header_puts_them(structure, name):
    assert getattr(structure, name).offset == KERNEL_OFFSETS[structure, name]


@given(st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=4))
def test_format_codes_survive_the_way_there_and_back(code):
    assert abi.fourcc_text(abi.fourcc(code)) == code


def test_the_layouts_hold_on_this_machine():
    assert (ctypes.sizeof(ctypes.c_long), sys.byteorder) == (8, "little")
