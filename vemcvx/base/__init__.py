"""Code that every part of the package may use: errors, checks of arrays, records, owned files, drawing."""
