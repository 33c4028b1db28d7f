# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The one exception for everything that the user, not the program, has to mend."""


class InputError(Exception):
    """
    A file, a value or an argument is wrong.

    The message is one line: file, key or row, value, what was expected, how to mend it. Commands
    print it to stderr and end with status 2.

    """

    def __init__(self, message):
        """Keep the message on one line, whatever text from a file it quotes."""
        super().__init__(' '.join(str(message).split()))
