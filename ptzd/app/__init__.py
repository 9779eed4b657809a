"""Composition root: the only room that names concrete adapters; wires, starts and stops them in order."""
