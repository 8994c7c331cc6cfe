"""The script that Blender's interpreter runs: a scene as JSON on standard input, the light of each frame on standard output.

Poses of further frames may follow the scene, one line of JSON each.

`blender.py` starts it in a Python interpreter that has bpy (GPL). It therefore imports nothing of this package and no
third-party module except bpy. A frame is float32 red, green, blue and alpha, scene-linear, bottom row first.
"""

from __future__ import annotations

import array
import importlib
import itertools
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

pictures = os.fdopen(os.dup(1), "wb")
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Blender prints to standard output, even on import
bpy: Any = importlib.import_module("bpy")


def main() -> None:
    """Build the scene, render its frames, then the further frames from standard input."""
    scene = json.loads(sys.stdin.readline())
    holders = build(scene)
    with tempfile.TemporaryDirectory() as folder:
        for poses in itertools.chain(scene["frames"], map(json.loads, iter(sys.stdin.readline, ""))):
            for holder, pose in zip(holders, poses, strict=True):
                holder.matrix_world = matrix(pose)
            pictures.write(shoot(Path(folder) / "light.exr"))
            pictures.flush()


def build(scene: dict[str, Any]) -> list[Any]:
    """Build a scene; returns the moving bodies in the order of the frames' poses."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render_settings(scene)
    make_world(scene["sky"])
    for lamp in scene["lamps"]:
        make_lamp(lamp)
    materials = {name: make_material(name, nodes) for name, nodes in scene["materials"].items()}
    holders = {name: place(name, None) for name in scene["moving"]}
    make_camera(scene["camera"], holders)
    for part in scene["parts"]:
        make_part(part, materials, holders)
    if scene["classes"]:
        show_classes()
    return [holders[name] for name in scene["moving"]]


def render_settings(scene: dict[str, Any]) -> None:
    """Set up Cycles on one thread, so that neither speed nor result depends on the number of cores."""
    render, cycles = bpy.context.scene.render, bpy.context.scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = scene["size"]
    render.resolution_percentage = 100
    render.threads_mode, render.threads = "FIXED", 1
    render.use_persistent_data = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "NONE"
    cycles.device = "CPU"
    cycles.samples, cycles.seed = scene["samples"], scene["seed"]
    cycles.use_adaptive_sampling = False
    cycles.filter_width = 1.2  # pixels; the default of 1.5 blurs small pictures
    cycles.use_animated_seed = False
    cycles.use_denoising, cycles.denoiser = not scene["classes"], "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 3, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.blur_glossy, cycles.sample_clamp_indirect = 1.0, 4.0
    cycles.debug_use_spatial_splits = False


def make_camera(spec: dict[str, Any], holders: dict[str, Any]) -> None:
    """A pinhole camera, in the world or on a body; `camera_spec` in blender.py derives its numbers from fx, fy, cx, cy."""
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_width, lens.lens = "HORIZONTAL", 36.0, spec["lens"]
    lens.shift_x, lens.shift_y = spec["shift"]
    lens.clip_start, lens.clip_end = spec["near"], spec["far"]
    render = bpy.context.scene.render
    render.pixel_aspect_x, render.pixel_aspect_y = spec["aspect"]
    camera = place("camera", lens)
    if spec["body"] is not None:
        camera.parent = holders[spec["body"]]
    camera.matrix_basis = matrix(spec["pose"])
    bpy.context.scene.camera = camera


def make_world(sky: dict[str, Any]) -> None:
    """Ambient light."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    enable_nodes(world)
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*sky["colour"], 1.0)
    background.inputs["Strength"].default_value = sky["strength"]


def make_lamp(lamp: dict[str, Any]) -> None:
    """A rectangular area light that shines along its negative z axis."""
    light = bpy.data.lights.new("lamp", "AREA")
    light.shape, (light.size, light.size_y) = "RECTANGLE", lamp["size"]
    light.energy, light.color = lamp["power"], lamp["colour"]
    place("lamp", light).matrix_world = matrix(lamp["pose"])


def make_part(part: dict[str, Any], materials: dict[str, Any], holders: dict[str, Any]) -> None:
    """A closed mesh, shaded smooth where faces meet at small angles, with bevelled edges."""
    mesh = bpy.data.meshes.new(part["material"])
    mesh.from_pydata(part["points"], [], part["faces"])
    mesh.materials.append(materials[part["material"]])
    shape = place(part["material"], mesh)
    shape.pass_index = part["number"]
    if part["body"] is not None:
        shape.parent = holders[part["body"]]
    if part["rounding"] > 0.0:
        bevel = shape.modifiers.new("rounding", "BEVEL")
        bevel.width, bevel.segments, bevel.limit_method, bevel.angle_limit = part["rounding"], 2, "ANGLE", 0.6
        shape.data = bpy.data.meshes.new_from_object(shape.evaluated_get(bpy.context.evaluated_depsgraph_get()))
        shape.modifiers.clear()
    shape.data.shade_smooth()
    shape.data.set_sharp_from_angle(angle=0.9)


def place(name: str, data: Any) -> Any:
    """Add an object to the scene."""
    placed = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(placed)
    return placed


def make_material(name: str, nodes: list[Any]) -> Any:
    """A material from nodes [type, settings, inputs], shader last; inputs are values or links ["@", node, output]."""
    material = bpy.data.materials.new(name)
    enable_nodes(material)
    tree = material.node_tree
    tree.nodes.clear()
    built: list[Any] = []
    for kind, settings, inputs in nodes:
        node = tree.nodes.new(kind)
        for key, value in settings.items():
            if key == "ramp":
                fill_ramp(node.color_ramp, value)
            else:
                setattr(node, key, value)
        for key, value in inputs.items():
            socket = node.inputs[int(key) if key.isdigit() else key]
            if isinstance(value, list) and value[0] == "@":
                output = value[2]
                tree.links.new(built[value[1]].outputs[output], socket)
            else:
                socket.default_value = value
        built.append(node)
    surface = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(built[-1].outputs[0], surface.inputs["Surface"])
    return material


def fill_ramp(ramp: Any, stops: list[Any]) -> None:
    """Set colours at positions 0..1; "constant" as the first stop means that they are not interpolated."""
    if stops[0] == "constant":
        ramp.interpolation, stops = "CONSTANT", stops[1:]
    while len(ramp.elements) < len(stops):
        ramp.elements.new(1.0)
    for element, (position, colour) in zip(ramp.elements, stops, strict=True):
        element.position, element.color = position, (*colour, 1.0)


def show_classes() -> None:
    """Render the class number at each pixel's centre instead of light."""
    nodes = [["ShaderNodeObjectInfo", {}, {}], ["ShaderNodeEmission", {}, {"Strength": ["@", 0, "Object Index"]}]]
    layer, scene = bpy.context.view_layer, bpy.context.scene
    layer.material_override = make_material("classes", nodes)
    scene.cycles.samples, scene.cycles.max_bounces = 1, 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01


def enable_nodes(block: Any) -> None:
    """Enable nodes before Blender 5; later versions always have them and deprecate the setting."""
    if block.node_tree is None:
        block.use_nodes = True


def matrix(rows: list[list[float]]) -> Any:
    """A pose (4 rows of 4) as Blender's matrix type."""
    return importlib.import_module("mathutils").Matrix(rows)


def shoot(path: Path) -> bytes:
    """Render one frame; returns its pixels."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Non-Color"
    values = array.array("f", bytes(4 * len(picture.pixels)))
    picture.pixels.foreach_get(values)
    bpy.data.images.remove(picture)
    path.unlink()
    return values.tobytes()


if __name__ == "__main__":
    main()
