"""The hard cases, subject by subject; `python problems/hard_cases.py` runs them."""
