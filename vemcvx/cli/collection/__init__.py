"""`vemcvx collection`: programs from the problem files, with certified optima and a script that confirms the optima."""

from vemcvx.cli.collection.writing import INSTANCES, Collection, CollectionInstance, write_collection

__all__ = ["INSTANCES", "Collection", "CollectionInstance", "write_collection"]
