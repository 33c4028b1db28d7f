"""The effects that a real set-up adds to the ideal stack, one file each."""
