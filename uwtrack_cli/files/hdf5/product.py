"""The one codec of product files: write, read, stream and verify.

Everything that reads or writes a product goes through the names of this module;
`Product` draws what a file looks like inside.
"""

from uwtrack_cli.files.hdf5.container_keys import ContainerKey
from uwtrack_cli.files.hdf5.examination import is_product
from uwtrack_cli.files.hdf5.history import HistoryStep, Source
from uwtrack_cli.files.hdf5.reader import (
    Product,
    read_product,
    read_product_bytes,
)
from uwtrack_cli.files.hdf5.verify import read_many, source_of, verify_product
from uwtrack_cli.files.hdf5.writer import ProductWriter, product_to_bytes, write_product

__all__ = [
    "ContainerKey",
    "HistoryStep",
    "Product",
    "ProductWriter",
    "Source",
    "is_product",
    "product_to_bytes",
    "read_many",
    "read_product",
    "read_product_bytes",
    "source_of",
    "verify_product",
    "write_product",
]
