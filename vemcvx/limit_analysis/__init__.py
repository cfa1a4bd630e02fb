"""Limit loads and shakedown factors from cone programs, without time steps."""
