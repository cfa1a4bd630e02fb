"""Reading and writing of mesh files, and conversion to and from other libraries."""
