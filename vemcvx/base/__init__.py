"""Code that every part of the package may use: errors, checks of arrays, records, output files, drawing."""
