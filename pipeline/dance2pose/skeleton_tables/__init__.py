"""The tables behind `dance2pose.skeleton`: names, lines and mappings as data, a module a family."""
