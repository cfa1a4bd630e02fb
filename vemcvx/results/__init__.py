"""Results of a simulation: fields, contact, probes, tables, files."""
