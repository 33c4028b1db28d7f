"""What an effect looks like: the same tests with and without it, drawn and described."""
