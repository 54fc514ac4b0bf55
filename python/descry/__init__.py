"""Describe and recognise coloured point clouds in numpy arrays, and read what Descry's runs have found."""

from .cloud_file import Cloud, read_cloud
from .descriptor import Descriptor, Signature, describe
from .errors import Error
from .recogniser import Answer, Named, Recogniser
from .run import Figure, Run

__all__ = [
    "Answer",
    "Cloud",
    "Descriptor",
    "Error",
    "Figure",
    "Named",
    "Recogniser",
    "Run",
    "Signature",
    "describe",
    "read_cloud",
]
