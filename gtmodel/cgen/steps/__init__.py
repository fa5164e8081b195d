"""Step functions: functions with a state that run once in a cycle, in C and in Python."""
