"""stub."""
def read(path):
    raise NotImplementedError
def write(path, mesh):
    raise NotImplementedError
def write_cells(path, mesh, point_data, cell_data):
    raise NotImplementedError
