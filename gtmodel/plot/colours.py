"""The colours of curves and links."""

# readable with colour-blind eyes (Okabe and Ito), dark ones first
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
