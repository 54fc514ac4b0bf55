"""Describe and recognise coloured point clouds in numpy arrays, and read what Descry's runs have found."""

from .descriptor import Descriptor, Signature, describe
from .errors import Error
from .recogniser import Answer, Named, Recogniser
from .run import Figure, Run

__all__ = ["Answer", "Descriptor", "Error", "Figure", "Named", "Recogniser", "Run", "Signature", "describe"]
