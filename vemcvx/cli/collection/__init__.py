"""`vemcvx collection`: graded instances from the problem files, certified optima, a script that confirms them."""

from vemcvx.cli.collection.writing import INSTANCES, Collection, Instance, write_collection

__all__ = ["INSTANCES", "Collection", "Instance", "write_collection"]
