"""`vemcvx collection`: graded instances from the problem files, with certified optima and a script to confirm these."""

from vemcvx.cli.collection.writing import INSTANCES, Collection, CollectionInstance, write_collection

__all__ = ["INSTANCES", "Collection", "CollectionInstance", "write_collection"]
