"""Uses of ``descry`` that mypy must refuse, each for the reason at the end of its line. Nothing runs it."""

import descry
import numpy as np

xyz = np.zeros((100, 3))
rgb = np.zeros((100, 3), np.uint8)
recogniser = descry.Recogniser("objects")

descry.read_cloud(b"bytes of a file")  # refused: arg-type
descry.read_cloud("cloud.ply").colours  # refused: attr-defined
descry.Recogniser(3)  # refused: arg-type
recogniser.recognise("cloud.ply", None, "000")  # refused: arg-type
recogniser.recognise(xyz, rgb, viewpoint=0.0)  # refused: arg-type
recogniser.recognise(xyz, rgb, top="3")  # refused: arg-type
recogniser.recognise(xyz, rgb, tip=3)  # refused: call-arg
recogniser.recognise_many([xyz], errors="ignore")  # refused: call-overload
recogniser.recognise_many([xyz], errors="return")[0].instance  # refused: union-attr
recogniser.recognise_many(3)  # refused: call-overload
recogniser.recognise(xyz).margin + 1  # refused: operator
descry.describe(xyz, rgb)  # refused: call-arg
descry.describe(xyz, rgb, None)  # refused: arg-type
descry.Descriptor(descriptor=3)  # refused: arg-type
descry.Descriptor("objects").transform([(xyz, rgb, "front")])  # refused: list-item
descry.Run("results/runs/demo").table(3)  # refused: arg-type
descry.Run("results/runs/demo").tables + ["more"]  # refused: operator
descry.Run("results/runs/demo").figure("convergence").save(3)  # refused: arg-type
descry.Error()  # refused: call-arg
descry.Figure("convergence")  # refused: call-arg
descry.recognise(xyz)  # refused: attr-defined
