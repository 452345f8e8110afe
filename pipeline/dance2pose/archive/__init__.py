"""Whole collections: every video of a folder, a list or a table into one verifiable package each.

`sources` says which videos there are, `ledger` what is known of each, `batch` what to do next,
`executors` where it runs, `worker` what is done with one video, `packages` what is kept of it.
"""
