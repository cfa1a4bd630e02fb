"""What every part of the package may use: errors, checked arrays, records, files that are ours, drawing."""
