"""Limit loads and shakedown: cone programs for a whole load or a whole cycle, without steps."""
