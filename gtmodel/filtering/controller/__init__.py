"""A filter for the loop: the plan of its steps, the twin in Python, the text in C."""
