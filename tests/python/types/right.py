"""A program that uses every public name of ``descry`` as it is meant; mypy must agree in all. Nothing runs it."""

from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, Union

import descry
import numpy as np
import polars
from numpy.typing import NDArray
from typing_extensions import assert_type

Floats = NDArray[np.float32]

# Clouds
cloud = descry.read_cloud("cloud.ply")
assert_type(cloud, descry.Cloud)
assert_type(descry.read_cloud(Path("cloud.pcd")).xyz, Floats)
assert_type(cloud.rgb, Optional[NDArray[np.uint8]])
assert_type(cloud.viewpoint, Tuple[float, float, float])
xyz = np.zeros((100, 3))
rgb = np.zeros((100, 3), np.uint8)

# Recognition
recogniser = descry.Recogniser(Path("objects"))
answer = recogniser.recognise(*cloud, top=3)
assert_type(answer, descry.Answer)
assert_type(answer.margin, Optional[float])
assert_type(answer.unknown, bool)
assert_type(answer.known_probability, Optional[float])
assert_type(answer.ranking, Tuple[descry.Named, ...])
assert_type(answer.ranking[0].instance, str)
assert_type(recogniser.recognise(xyz), descry.Answer)
assert_type(recogniser.recognise([[0, 0, 1], [0, 1, 1]], None, viewpoint=[0, 0, 0]), descry.Answer)
assert_type(recogniser.recognise_many([cloud, xyz, (xyz, rgb), (xyz, None, (0, 0, 0))]), List[descry.Answer])
assert_type(recogniser.recognise_many([xyz], errors="raise"), List[descry.Answer])
assert_type(recogniser.recognise_many([xyz], 2, "return"), List[Union[descry.Answer, descry.Error]])
for given in recogniser.recognise_many([xyz], errors="return"):
    if isinstance(given, descry.Error):
        assert_type((given.what, given.got, given.advice), Tuple[str, str, str])
    else:
        assert_type(given.instance, str)

# Description
signature = descry.describe(xyz, rgb, "objects", viewpoint=(0, 0, 0))
assert_type(signature, descry.Signature)
assert_type(descry.describe(xyz, None, Path("structure.toml")), descry.Signature)
assert_type(signature.channels, List[Tuple[Floats, Floats]])
values: Floats = signature
assert_type(float(signature[0]), float)
descriptor = descry.Descriptor("objects")
assert_type(descriptor.fit([cloud]).transform([cloud, (xyz, rgb)]), Floats)
assert_type(descriptor.fit_transform([cloud], ["mug"]), Floats)
assert_type(descriptor.set_params(descriptor="other"), descry.Descriptor)
assert_type(descriptor.get_params(), Dict[str, Any])

# Runs
run = descry.Run("results/runs/demo")
assert_type(run.tables(), List[str])
assert_type(run.table("generations"), polars.DataFrame)
assert_type(run.query("SELECT 1"), polars.DataFrame)
assert_type(run.winner, Dict[str, Any])
assert_type(run.summary, Dict[str, Any])
figure = run.figure("convergence", program="coordinator")
assert_type(figure, descry.Figure)
assert_type((figure.name, figure.svg), Tuple[str, str])
figure.save(Path("convergence.svg"))
