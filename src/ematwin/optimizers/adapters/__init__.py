"""Optimisers of other libraries behind this package's ask/tell promise.

One file a library. A library is imported when one of its optimisers is made, not before, so that
listing the names needs none of them.
"""
