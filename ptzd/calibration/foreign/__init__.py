"""Calibrations of other tools: their files as plain values, each number accounted for, and the lens they describe."""
