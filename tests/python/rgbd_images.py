"""Makes images of a data set of clouds, and the clouds that these images show, by numpy and Pillow, without any code of
Descry.

Usage: rgbd_images.py DATA OUT, where DATA is as `coordinator synth` writes it.

Below OUT:

- `crops/`: each cloud as the RGB-D Object Dataset has it, `<name>_crop.png`, `<name>_depthcrop.png`, `<name>_maskcrop.png`
  and `<name>_loc.txt`, for the camera of that data set, and the lists with these names; `crops-pcd/`: the same points as
  PCD, whose names end in .pcd instead of _crop.png.
- `scenes/`: a scene of the BOP benchmark for each video, with two objects in each image, for the camera of YCB-Video;
  `scenes-pcd/`: the same points as PCD, named as the masks of `scenes`, with a manifest, `clouds.csv`. Both have the lists.

A point goes to the pixel that is nearest to its ray; of two, the nearer one stays. Depths are rounded to whole units, so
that the clouds of the images are not those of DATA.
"""

import argparse
import collections
import json
import pathlib

import numpy as np
from PIL import Image

from cospair import read

SIZE = 640, 480
Camera = collections.namedtuple("Camera", "fx fy cx cy unit")
# The axis is at column 320 and row 240 from 1.
KINECT = Camera(570.3, 570.3, 319.0, 239.0, 0.001)
DEPTH_SCALE = 0.1
YCB_VIDEO = Camera(1066.778, 1067.487, 312.9869, 241.3109, DEPTH_SCALE * 0.001)


def drawn(camera, xyz, rgb):
    """Depths and colours of the whole image; depth 0 where there is nothing."""
    width, height = SIZE
    xyz = xyz.astype("f8")
    u = np.rint(xyz[:, 0] / xyz[:, 2] * camera.fx + camera.cx).astype(int)
    v = np.rint(xyz[:, 1] / xyz[:, 2] * camera.fy + camera.cy).astype(int)
    d = np.rint(xyz[:, 2] / camera.unit).astype(int)
    seen = (0 <= u) & (u < width) & (0 <= v) & (v < height) & (0 < d) & (d < 1 << 16)
    assert seen.all(), f"{(~seen).sum()} points are out of the image"
    depth, colour = np.zeros((height, width), "u2"), np.zeros((height, width, 3), "u1")
    for point in np.argsort(-d, kind="stable"):
        depth[v[point], u[point]] = d[point]
        colour[v[point], u[point]] = rgb[point]
    return depth, colour


def shown(camera, depth, colour, mask):
    """The points of the pixels, row by row, and their colours."""
    v, u = np.nonzero(mask & (depth > 0))
    z = depth[v, u].astype("f8") * camera.unit
    x = (u - camera.cx) * z / camera.fx
    y = (v - camera.cy) * z / camera.fy
    return np.stack([x, y, z], axis=1).astype("f4"), colour[v, u]


def write_pcd(path, xyz, rgb):
    table = np.empty(len(xyz), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
    table["x"], table["y"], table["z"] = xyz.T
    red, green, blue = rgb.astype("u4").T
    table["rgb"] = red << 16 | green << 8 | blue
    header = (
        "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(xyz)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(xyz)}\nDATA binary\n"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header.encode() + table.tobytes())


def write_mask(number, mask, path):
    """Of one bit or eight, in turns."""
    image = Image.fromarray(mask.astype("u1") * 255)
    (image.convert("1") if number % 2 else image).save(path)


def crops(number, name, xyz, rgb, out):
    depth, colour = drawn(KINECT, xyz, rgb)
    rows, columns = np.nonzero(depth)
    top, left = rows.min() - 2, columns.min() - 3
    part = np.s_[top : rows.max() + 2, left : columns.max() + 4]
    target = out / "crops" / name
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = lambda ending: target.with_name(target.stem + ending)
    # What is in front of the object, and its surroundings, have colours, and may have depths.
    mask = depth[part] > 0
    Image.fromarray(np.where(mask[..., None], colour[part], 200).astype("u1")).save(beside("_crop.png"))
    Image.fromarray(np.where(mask, depth[part], 900).astype("u2")).save(beside("_depthcrop.png"))
    write_mask(number, mask, beside("_maskcrop.png"))
    beside("_loc.txt").write_text(f"{left + 1},{top + 1}\n")
    write_pcd(out / "crops-pcd" / name, *shown(KINECT, depth, colour, depth > 0))


def scene(folder, clouds, numbers, out):
    """Two clouds an image; returns the masks' paths by the clouds' names."""
    paths, cameras, objects = {}, {}, {}
    for kind in ("rgb", "depth", "mask", "mask_visib"):
        (out / "scenes" / folder / kind).mkdir(parents=True, exist_ok=True)
    for image, first in enumerate(range(0, len(clouds), 2)):
        pair = clouds[first : first + 2]
        # Side by side, so that neither hides the other.
        aside = [np.array([0.02 * side, 0.0, 0.0]) for side in (-1, 1)]
        views = [drawn(YCB_VIDEO, xyz + moved, rgb) for (_, xyz, rgb), moved in zip(pair, aside)]
        depths = np.stack([np.where(depth > 0, depth.astype("i4"), 1 << 16) for depth, _ in views])
        nearest = depths.argmin(axis=0)
        depth = np.where(depths.min(axis=0) < 1 << 16, depths.min(axis=0), 0).astype("u2")
        colour = np.choose(nearest[..., None], [colour for _, colour in views]).astype("u1")
        Image.fromarray(colour).save(out / "scenes" / folder / "rgb" / f"{image:06}.png")
        Image.fromarray(depth).save(out / "scenes" / folder / "depth" / f"{image:06}.png")
        matrix = [YCB_VIDEO.fx, 0.0, YCB_VIDEO.cx, 0.0, YCB_VIDEO.fy, YCB_VIDEO.cy, 0.0, 0.0, 1.0]
        cameras[str(image)] = {"cam_K": matrix, "depth_scale": DEPTH_SCALE}
        objects[str(image)] = []
        for number, (name, _, _) in enumerate(pair):
            mask = f"{image:06}_{number:06}.png"
            visible = (nearest == number) & (depth > 0)
            write_mask(image, visible, out / "scenes" / folder / "mask_visib" / mask)
            write_mask(image, views[number][0] > 0, out / "scenes" / folder / "mask" / mask)
            pose = {"cam_R_m2c": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "cam_t_m2c": [0.0, 0.0, 500.0]}
            objects[str(image)].append({**pose, "obj_id": numbers[name.parent.name]})
            paths[name] = f"{folder}/mask_visib/{mask}"
            write_pcd((out / "scenes-pcd" / paths[name]).with_suffix(".pcd"), *shown(YCB_VIDEO, depth, colour, visible))
    (out / "scenes" / folder / "scene_camera.json").write_text(json.dumps(cameras))
    (out / "scenes" / folder / "scene_gt.json").write_text(json.dumps(objects))
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    args = parser.parse_args()
    videos, paths = collections.defaultdict(list), {}
    sources = sorted(args.data.glob("*/*/*.pcd"))
    numbers = {name: number + 1 for number, name in enumerate(sorted({source.parent.name for source in sources}))}
    for number, source in enumerate(sources):
        xyz, rgb, _ = read(source)
        name = source.relative_to(args.data)
        crops(number, name, xyz, rgb, args.out)
        videos[int(source.stem.split("_")[-2])].append((name, xyz, rgb))
    for video, clouds in videos.items():
        paths.update(scene(f"{video:06}", clouds, numbers, args.out))
    rows = ["path,category,instance,sequence"]
    for name, path in paths.items():
        instance = f"obj_{numbers[name.parent.name]:06}"
        rows.append(f"{path.replace('.png', '.pcd')},{instance},{instance},{path.split('/')[0]}")
    (args.out / "scenes-pcd" / "clouds.csv").write_text("\n".join(rows) + "\n")
    for source in args.data.glob("*.txt"):
        names = source.read_text().split()
        masks = [paths[pathlib.PurePath(name)] for name in names if pathlib.PurePath(name) in paths]
        lists = {
            "crops": [name.replace(".pcd", "_crop.png") for name in names],
            "crops-pcd": names,
            "scenes": masks,
            "scenes-pcd": [mask.replace(".png", ".pcd") for mask in masks],
        }
        for folder, lines in lists.items():
            (args.out / folder / source.name).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
