"""Faults done to running nodes on purpose, and what must hold meanwhile and afterwards."""
