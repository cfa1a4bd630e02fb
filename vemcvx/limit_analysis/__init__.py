"""Limit loads: cone programs for a whole load, without steps."""
