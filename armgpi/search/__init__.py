"""Searches for a law's numbers on drawn scenarios, for `armgpi tune` and `armgpi contend`.

``space`` says what is free, ``objective`` what is wanted, ``evaluation`` runs a generation as one batch,
``optimisers`` propose, ``study`` does the search and keeps it in a folder, ``contend`` holds laws against
each other.
"""
