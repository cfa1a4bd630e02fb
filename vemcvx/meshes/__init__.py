from .polygon_mesh import PolygonMesh
