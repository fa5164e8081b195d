"""The other filters of the family, each with the interface of `gtmodel.filtering.Filter`; `make` finds them by name."""
