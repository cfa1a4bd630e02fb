"""`vemcvx collection`: graded instances from the problem files, certified optima, a script that confirms them."""

from vemcvx.cli.collection.instances import INSTANCES, Instance
from vemcvx.cli.collection.writing import Collection, write_collection

__all__ = ["INSTANCES", "Collection", "Instance", "write_collection"]
