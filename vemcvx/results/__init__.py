"""What a simulation leaves, in the words of contact: fields, probes, files."""
