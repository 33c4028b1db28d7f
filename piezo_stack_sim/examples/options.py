# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Types of arguments that the examples take, with what was expected if they are wrong."""

import argparse
from pathlib import Path


def seed(text: str) -> int:
    """Return the seed that a text gives."""
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f'{text!r}: expected a whole number, zero or more')
    return int(text)


def folder(text: str) -> Path:
    """Return the folder that a text names; '' would be the one that one happens to be in."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f'{text!r}: expected a folder; . is this one')
    return Path(text)
