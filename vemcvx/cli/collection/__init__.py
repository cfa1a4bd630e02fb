"""`vemcvx collection`: files of step programs with certified optima."""

from vemcvx.cli.collection.writing import INSTANCES, Collection, CollectionInstance, write_collection

__all__ = ["INSTANCES", "Collection", "CollectionInstance", "write_collection"]
