"""The subcommands of ``piezo_stack``: one module each, imported when it is called."""
