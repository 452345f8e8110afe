"""The default lifter: depth from a network, then one body solved over the whole track."""
