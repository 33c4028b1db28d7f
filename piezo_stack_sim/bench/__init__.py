"""Speed and accuracy of the plant beside those of other ways to compute the same device."""
