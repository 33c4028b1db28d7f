"""Where the simulation differs from recordings, which effect causes it, how far it shrinks."""
