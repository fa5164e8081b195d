"""Further filters with the interface of `gtmodel.filtering.Filter`; `make` creates one by its name."""
