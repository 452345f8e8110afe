"""The Rerun recording: what is in it, how it is laid out and styled, and the picture beside it."""
