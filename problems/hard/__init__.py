"""The hard cases by subject; `python problems/hard_cases.py` runs the cases."""
