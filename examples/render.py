#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Turns a simulation's frames into pictures and a video; needs no X server.

reads   DIR/particles.pvd, DIR/frames/*.vtp   particles [m], y up; of several ranks *.pvtp and their pieces
        DIR/obstacles.json                    spacing of the particles, frames per second, obstacles and their poses,
                                              what colours the particles, what they are compared with
writes  DIR/pictures/frame_0000.png ..., DIR/video.mp4 (H.264), or with --sheet FILE one picture
"""
import argparse
import ctypes.util
import json
import math
import os
import sys
import time
import xml.etree.ElementTree
from pathlib import Path


def stop(sentence):
    sys.exit(f"render.py: {sentence}")


try:
    import matplotlib.backends.backend_agg
    import matplotlib.collections
    import matplotlib.figure
    import matplotlib.patches
    import numpy as np
    import pyvista as pv
    import vtk
    from PIL import Image
except ImportError as missing:
    stop(f"the Python package '{missing.name}' is missing: pip install pyvista matplotlib imageio imageio-ffmpeg")

SNOW, SUN, SKY = np.array([0.96, 0.985, 1.0]), np.array([1.0, 0.96, 0.91]), np.array([0.72, 0.84, 1.0])
FLOOR, WALL = np.array([0.66, 0.66, 0.67]), np.array([0.53, 0.54, 0.56])
OBSTACLES = [((0.93, 0.42, 0.16), (0.98, 0.64, 0.30)), ((0.12, 0.45, 0.55), (0.22, 0.60, 0.68)),
             ((0.60, 0.20, 0.33), (0.74, 0.33, 0.45))]
KINDS = np.array([(0.86, 0.22, 0.20), (0.95, 0.66, 0.12), (0.20, 0.60, 0.36), (0.20, 0.45, 0.80)])
MATERIALS = {"snow": (0.99, 0.99, 1.0), "sand": (0.80, 0.60, 0.32), "water": (0.20, 0.47, 0.78)}
GROUND, AIR, MARK = (0.45, 0.46, 0.48), (0.80, 0.85, 0.91), (0.85, 0.15, 0.12)
BACKGROUND_LOW, BACKGROUND_HIGH = (0.72, 0.78, 0.85), (0.36, 0.46, 0.60)
UP = np.array([0.0, 1.0, 0.0])


def unit(v):
    return v / np.linalg.norm(v)


def rotation(quaternion):
    """The matrix of a quaternion [w, x, y, z]."""
    w, x, y, z = unit(np.asarray(quaternion, float))
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


# ---- reading ------------------------------------------------------------------------------------------------------


def read_frame_list(folder):
    """The file and the time [s] of each frame."""
    index = folder / "particles.pvd"
    try:
        data_sets = xml.etree.ElementTree.parse(index).getroot().iter("DataSet")
        frames = [(folder / data_set.attrib["file"], float(data_set.attrib["timestep"])) for data_set in data_sets]
    except OSError:
        stop(f"there is no {index}: run the simulation first, or name its output folder.")
    except (xml.etree.ElementTree.ParseError, KeyError, ValueError) as error:
        stop(f"{index} is not a ParaView data index ({error}).")
    if not frames:
        stop(f"{index} lists no frames.")
    return zip(*frames)


def read_particles(path, field=None):
    """The positions [m] of one frame, an n x 3 array; with the name of a field its values as well."""
    if not path.is_file():
        stop(f"the frame {path} is missing.")
    reader, errors = vtk.vtkXMLPPolyDataReader() if path.suffix == ".pvtp" else vtk.vtkXMLPolyDataReader(), []
    for source in (reader, reader.GetReaderErrorObserver() or reader):
        source.AddObserver("ErrorEvent", lambda *_: errors.append(True))
    reader.SetFileName(str(path))
    reader.Update()
    points = reader.GetOutput().GetPoints()
    if errors or points is None or points.GetNumberOfPoints() == 0:
        stop(f"the frame {path} cannot be read: it is broken or holds no particles.")
    points = np.array(pv.wrap(reader.GetOutput()).points, dtype=np.float64)
    if not np.isfinite(points).all():
        stop(f"the frame {path} holds positions that are not finite.")
    if field is None:
        return points
    values = pv.wrap(reader.GetOutput()).point_data.get(field)
    if values is None:
        stop(f"the frame {path} holds no field '{field}'.")
    return points, np.array(values, float)


def surface_mesh(shape, spec, folder):
    """The surface of an obstacle in its own frame."""
    if shape == "sphere":
        return pv.Sphere(radius=spec["radius"], theta_resolution=192, phi_resolution=97, direction=(0, 1, 0))
    if shape == "box":
        a, b, c = spec["half_extents"]
        return pv.Box(bounds=(-a, a, -b, b, -c, c), level=48).triangulate()
    if shape == "capsule":
        mesh = pv.Sphere(radius=spec["radius"], theta_resolution=128, phi_resolution=98, direction=(0, 1, 0))
        mesh.points[:, 1] += np.where(mesh.points[:, 1] > 0, 1, -1) * spec["half_length"]
        return mesh
    if shape == "mesh":
        path = Path(spec["file"]) if Path(spec["file"]).is_absolute() else folder / spec["file"]
        if not path.is_file():
            stop(f"the obstacle's mesh {path} is missing.")
        mesh = pv.read(path)
        if mesh.n_cells == 0:
            stop(f"the obstacle's mesh {path} holds no faces.")
        return pv.PolyData(mesh.points, mesh.faces).triangulate()
    stop(f"obstacles.json names the unknown shape '{shape}' (known: sphere, box, capsule, half_space, mesh).")


class Obstacle:
    """A solid: its surface in its own frame, points spread over it and just within it, and one pose per frame."""

    def __init__(self, number, spec, folder, frames, spacing):
        self.shape = spec["shape"]
        poses = spec.get("poses") or [{"position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}]
        if len(poses) not in (1, frames):
            stop(f"obstacle {number} in obstacles.json has {len(poses)} poses for {frames} frames.")
        self.poses = [(np.array(p["position"], float), rotation(p["quaternion"])) for p in poses]
        if self.shape == "half_space":
            self.point, self.normal = np.array(spec["point"], float), unit(np.array(spec["normal"], float))
            return
        mesh = surface_mesh(self.shape, spec, folder).compute_normals(split_vertices=True, feature_angle=40)
        self.points, self.normals = np.array(mesh.points, float), np.array(mesh.point_data["Normals"], float)
        self.mesh = mesh
        corners = self.points[mesh.regular_faces]
        crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(crosses, axis=1) / 2
        count = int(min(2e5, 3 * areas.sum() / spacing**2)) + 1
        random = np.random.default_rng(0)
        chosen = random.choice(len(corners), count, p=areas / areas.sum())
        weights = random.dirichlet((1, 1, 1), count)
        self.samples = np.einsum("nk,nkd->nd", weights, corners[chosen])
        inward = -crosses[chosen] / (2 * areas[chosen, None])
        self.within = np.concatenate([self.samples + depth * spacing * inward for depth in (3, 5)])
        plain, other = (np.array(c) for c in OBSTACLES[number % len(OBSTACLES)])
        stripe = np.zeros(len(self.points))  # shows how a round obstacle turns
        if self.shape in ("sphere", "capsule"):
            stripe = np.clip(0.5 + 1.5 * np.sin(6 * np.arctan2(self.points[:, 0], self.points[:, 2])), 0, 1)
        self.colour = plain + stripe[:, None] * (other - plain)

    def pose(self, frame):
        return self.poses[frame if len(self.poses) > 1 else 0]

    def place(self, frame, points):
        position, turn = self.pose(frame)
        return points @ turn.T + position


class Scene:
    def __init__(self, folder):
        self.folder = folder
        self.frames, self.times = read_frame_list(folder)
        description = folder / "obstacles.json"
        try:
            data = json.loads(description.read_text())
            self.spacing = float(data["particle_spacing"])
            self.frames_per_second = float(data["frames_per_second"])
            if not (0 < self.spacing < math.inf and 0 < self.frames_per_second < math.inf):
                raise ValueError("particle_spacing and frames_per_second must be positive")
            self.camera, self.title = data.get("camera"), data.get("title", "")
            self.dimensions, self.colour_by = data.get("dimensions", 3), data.get("colour_by") or None
            self.names, self.marks = data.get("names", []), data.get("marks", [])
            obstacles = [Obstacle(i, spec, folder, len(self.frames), self.spacing)
                         for i, spec in enumerate(data["obstacles"])]
        except OSError:
            stop(f"there is no {description}: the simulation writes it next to particles.pvd.")
        except KeyError as error:
            stop(f"{description} lacks {error}.")
        except (ValueError, TypeError, AttributeError, IndexError) as error:
            stop(f"{description} is broken ({error}).")
        self.solids = [o for o in obstacles if o.shape != "half_space"]
        self.half_spaces = [o for o in obstacles if o.shape == "half_space"]

    def seen(self):
        """Points that stand for all that is seen in any frame."""
        parts = []
        for frame in {round(i) for i in np.linspace(0, len(self.frames) - 1, 16)}:
            points = read_particles(self.frames[frame])
            points = points[:: max(1, len(points) // 2000)]
            low, high = np.percentile(points, (0.5, 99.5), axis=0)
            parts += [points[((points >= low) & (points <= high)).all(1)]]
            parts += [o.place(frame, o.samples[:: max(1, len(o.samples) // 500)]) for o in self.solids]
        return np.concatenate([part for part in parts if len(part)])


# ---- light --------------------------------------------------------------------------------------------------------


def neighbours(values, axis):
    """The values one step before and one step after along an axis; an edge is its own neighbour."""
    size = values.shape[axis]
    padded = np.pad(values, [(1, 1) if a == axis else (0, 0) for a in range(values.ndim)], mode="edge")
    return padded.take(range(size), axis), padded.take(range(2, size + 2), axis)


class Fog:
    """How much of each voxel is filled: light is followed through it for soft shadows and for the open sky."""

    def __init__(self, points, spacing, solid_points=(), half_spaces=()):
        low, high = points.min(0), points.max(0)
        self.cell = max(2.0 * spacing, (np.prod(high - low + 8 * spacing) / 4e6) ** (1 / 3))
        self.origin = low - 4 * self.cell
        self.shape = np.ceil((high - self.origin) / self.cell).astype(int) + 5
        self.full = (self.cell / spacing) ** 3
        self.count = self._bin(points)
        filled = np.minimum(self.count / (0.7 * self.full), 1).astype(np.float32)
        for solid in solid_points:
            filled[self._bin(solid) > 0] = 1
        for origin, normal in half_spaces:
            axes = [self.origin[i] + (np.arange(self.shape[i]) + 0.5) * self.cell - origin[i] for i in range(3)]
            height = sum(np.ix_(*axes)[i] * normal[i] for i in range(3))
            filled[height < 0] = 1
        for axis in range(3):
            before, after = neighbours(filled, axis)
            filled = (before + 2 * filled + after) / 4
        self.filled = np.ascontiguousarray(filled)

    def _voxels(self, points):
        return ((points - self.origin) / self.cell).astype(np.float32)

    def _index(self, voxels):
        """Where these voxel coordinates lie in the flat arrays; the rim, which is empty, stands for what is outside."""
        index = np.zeros(len(voxels), np.int32)
        for axis in range(3):
            index *= self.shape[axis]
            index += np.clip(voxels[:, axis], 0, self.shape[axis] - 1).astype(np.int32)
        return index

    def _bin(self, points):
        voxels = self._voxels(points)
        voxels = voxels[((voxels >= 0) & (voxels < self.shape)).all(1)]
        return np.bincount(self._index(voxels), minlength=self.shape.prod()).reshape(self.shape)

    def on_surface(self, points):
        """False for particles that are buried on all sides."""
        buried = self.count >= 0.5 * self.full
        for axis in range(3):
            before, after = neighbours(buried, axis)
            buried = buried & before & after
        return ~buried.ravel()[self._index(self._voxels(points))]

    def outward(self, points, otherwise):
        """Unit normals of the filled region near its surface; where there is no saying, mostly `otherwise`."""
        index = self._index(self._voxels(points))
        normals = np.stack([-np.gradient(self.filled, axis=axis).ravel()[index] for axis in range(3)], 1)
        normals += 0.06 * otherwise
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)

    def light(self, points, direction, first, last, step=1.0, growth=1.0, density=0.6):
        """The share of light [0, 1] that reaches points from a direction, between two distances in voxels."""
        voxels, filled = self._voxels(points), self.filled.ravel()
        direction = np.asarray(direction, np.float32)
        rooms = [(self.shape[i] - voxels[:, i].min() if direction[i] > 0 else voxels[:, i].max()) / abs(direction[i])
                 for i in range(3) if abs(direction[i]) > 1e-3]
        depth, distance = np.zeros(len(points), np.float32), first
        while distance < min(last, *rooms):
            depth += filled[self._index(voxels + direction * np.float32(distance))] * np.float32(step)
            distance += step
            step *= growth
        return np.exp(-density * depth)

    def sky(self, points, normals):
        """The share of open sky [0, 1] over points."""
        total, weights = np.zeros(len(points), np.float32), np.full(len(points), 1e-6, np.float32)
        start = points + normals * self.cell
        for x, y, z in ((0, 1, 0), (1, 0.5, 0.3), (-0.3, 0.5, 1), (-1, 0.5, -0.3), (0.3, 0.5, -1), (1, -0.4, -1),
                        (-1, -0.4, 1), (1, -0.4, 1), (-1, -0.4, -1)):
            direction = unit(np.array([x, y, z], float))
            weight = np.maximum(normals @ direction + 0.35, 0) * (0.6 + 0.4 * max(y, 0))
            total += weight * self.light(start, direction, 1.2, 14, growth=1.7, density=0.4)
            weights += weight
        return total / weights


def blur(image, radius):
    """Two box filters of this radius in texels along each axis."""
    for axis in (0, 1, 0, 1):
        pad = [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)]
        total = np.cumsum(np.pad(image, pad, mode="edge"), axis=axis, dtype=np.float64)
        size = image.shape[axis]
        upper = np.take(total, np.arange(2 * radius + 1, 2 * radius + 1 + size), axis=axis)
        image = (upper - np.take(total, np.arange(size), axis=axis)) / (2 * radius + 1)
    return image


# ---- the picture --------------------------------------------------------------------------------------------------


class Picture:
    """The plotter with its camera, lights and actors; `draw` renders one frame."""

    def __init__(self, scene, size, best):
        self.scene, self.best = scene, best
        self.size, self.scale = size, 2  # four samples per pixel cost little: the time goes into the cubes' corners
        seen = scene.seen()
        low, high = seen.min(0), seen.max(0)
        self.centre, self.reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self.plotter = pv.Plotter(off_screen=True, window_size=[s * self.scale for s in size], lighting="none")
        self.plotter.set_background(BACKGROUND_LOW, top=BACKGROUND_HIGH)
        self._aim(seen, size[0] / size[1])
        self._light()
        self._actors()
        if best:
            self.plotter.enable_ssao(radius=3 * scene.spacing, bias=0.5 * scene.spacing, kernel_size=64, blur=True)
        self.plotter.disable_anti_aliasing()

    def _aim(self, seen, aspect):
        camera, angle = self.plotter.camera, 28.0
        towards = unit(np.array([0.42, 0.30, 1.0]))
        for wall in self.scene.half_spaces:  # look from outside of every half-space
            normal = wall.pose(0)[1] @ wall.normal
            if normal @ UP < 0.7 and normal @ towards < 0.25:
                towards = unit(towards + (0.4 - normal @ towards) * normal)
        focus = self.centre
        given = self.scene.camera
        if given:
            try:
                position, focus = np.array(given["position"], float), np.array(given["focal_point"], float)
                towards = unit(position - focus)
            except (KeyError, TypeError, ValueError):
                stop("the camera in obstacles.json needs a position and a focal_point, three numbers each.")
        self.right = unit(np.cross(UP, towards)) if abs(towards[1]) < 0.999 else np.array([1.0, 0, 0])
        self.towards = towards
        if not given:
            above, half = np.cross(towards, self.right), math.tan(math.radians(angle / 2))
            for _ in range(3):  # the middle of what is seen moves with the distance
                distance = max((seen - focus) @ towards + 1.12 * np.maximum(
                    np.abs((seen - focus) @ above), np.abs((seen - focus) @ self.right) / aspect) / half)
                depth = distance - (seen - focus) @ towards
                for axis in (above, self.right):
                    angles = (seen - focus) @ axis / depth
                    focus = focus + axis * distance * (angles.max() + angles.min()) / 2
            position = focus + distance * towards
        camera.position, camera.focal_point, camera.up, camera.view_angle = position, focus, UP, angle
        far = float(np.linalg.norm(position - self.centre))
        camera.clipping_range = (max(far - 2.5 * self.reach, 0.01 * far), far + 12 * self.reach)

    def _light(self):
        sun = unit(-0.62 * self.right + 1.0 * UP + 0.5 * unit(self.towards * [1, 0, 1] + 1e-9))
        for wall in self.scene.half_spaces:
            normal = wall.pose(0)[1] @ wall.normal
            sun = unit(sun + max(0.15 - normal @ sun, 0) * normal)
        self.sun = sun
        for direction, colour, strength in ((sun, SUN, 0.62), (UP, SKY, 0.30), (self.towards, (1, 1, 1), 0.32)):
            light = pv.Light(position=self.centre + direction * 10 * self.reach, focal_point=self.centre,
                             color=tuple(colour), intensity=strength, light_type="scene light")
            light.positional = False
            self.plotter.add_light(light)

    def _actors(self):
        self.planes = []
        for half_space in sorted(self.scene.half_spaces, key=lambda h: -abs(h.normal @ UP)):
            plane = pv.PolyData(np.zeros((4, 3)), faces=[4, 0, 1, 2, 3])
            plane.active_texture_coordinates = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
            texture = pv.Texture(np.zeros((2, 2, 4), np.uint8))
            actor = self.plotter.add_mesh(plane, texture=texture, lighting=False, show_scalar_bar=False)
            actor.ForceTranslucentOn()
            self.planes.append((half_space, plane, actor))
        for solid in self.scene.solids:
            solid.mesh["colour"] = np.zeros((len(solid.points), 3), np.uint8)
            solid.actor = self.plotter.add_mesh(solid.mesh, scalars="colour", rgb=True, ambient=0.25, diffuse=0.85,
                                                specular=0.25, specular_power=30)
            solid.actor.prop.interpolation = "Phong"
        self.cubes = vtk.vtkGlyph3DMapper()
        self.cubes.SetSourceData(pv.Cube(x_length=1, y_length=1, z_length=1, clean=False))
        self.cubes.SetScaleFactor(1.05 * self.scene.spacing)
        self.cubes.ScalingOn()
        self.cubes.SetScaleModeToNoDataScaling()
        self.cubes.OrientOff()
        self.cubes.SetScalarModeToUsePointFieldData()
        self.cubes.SelectColorArray("colour")
        self.cubes.SetColorModeToDirectScalars()
        actor = vtk.vtkActor()
        actor.SetMapper(self.cubes)
        actor.GetProperty().SetAmbient(0.80 if self.best else 0.68)
        actor.GetProperty().SetDiffuse(0.60)
        self.plotter.add_actor(actor, reset_camera=False, render=False)

    def _shade_cubes(self, points, fog, own):
        """Colours of particles of these own colours: the sun where it reaches them, the sky where it is open."""
        normals = fog.outward(points, 0.5 * (self.sun + self.towards))
        facing = np.clip(normals @ self.sun * 0.95 + 0.2, 0, 1)
        sun = fog.light(points + normals * fog.cell, self.sun, 1.7, 400, step=1.3, growth=1.03) * facing
        sky = fog.sky(points, normals)
        light = 0.54 * sun[:, None] * SUN + (0.10 + 0.36 * sky[:, None]) * SKY
        return own * (1 - np.exp(-2.3 * light))  # keeps some shape where it is brightest

    def _shade_plane(self, half_space, plane, actor, frame, points):
        """Lays the plane under the scene, with the shadows of everything on it."""
        position, turn = half_space.pose(frame)
        normal, origin = turn @ half_space.normal, turn @ half_space.point + position
        u = unit(np.cross(normal, [0, 0, 1] if abs(normal[2]) < 0.9 else [1, 0, 0]))
        v = np.cross(normal, u)
        centre = self.centre - normal * ((self.centre - origin) @ normal)
        reach, texels = 4.0 * self.reach, 1536 if self.best else 800
        plane.points = np.array([centre + reach * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])

        height = (points - origin) @ normal
        texel = 2 * reach / texels
        per_texel = (self.scene.spacing / texel) ** 2

        def splat(at, weights):
            i, j = (((at - centre) @ axis + reach) / texel for axis in (u, v))
            keep = (i >= 0) & (j >= 0) & (i < texels) & (j < texels)
            index = j[keep].astype(int) * texels + i[keep].astype(int)
            return np.bincount(index, weights[keep], texels * texels).reshape(texels, texels)

        above = height > -self.scene.spacing
        points, height = points[above], np.maximum(height[above], 0)
        tilt = float(normal @ self.sun)
        shadow = np.zeros((texels, texels))
        if tilt > 0.02:
            cast = points - self.sun * (height / tilt)[:, None]
            near = height < 0.5 * self.reach  # the penumbra widens with the height
            radius = max(1, round(0.7 * self.scene.spacing / texel))
            for part, wider in ((near, 1), (~near, 3)):
                if part.any():
                    covered = blur(splat(cast[part], np.full(part.sum(), per_texel)), radius * wider)
                    shadow = 1 - (1 - shadow) * np.exp(-1.6 * covered)
        close = splat(points, per_texel * np.exp(-height / (0.07 * self.reach)))
        contact = blur(np.minimum(close, 1.5), max(2, round(0.07 * self.reach / texel)))
        nearest = np.full((texels, texels), np.inf)  # distance to the other half-spaces: dark corners, nothing within
        along = (np.arange(texels) + 0.5) * texel - reach
        for other, _, _ in self.planes:
            if other is not half_space:
                toward = other.pose(frame)[1] @ other.normal
                start = (centre - other.place(frame, other.point)) @ toward
                nearest = np.minimum(nearest, start + along * (u @ toward) + along[:, None] * (v @ toward))
        contact = contact + 0.35 * np.exp(-np.maximum(nearest, 0) / (0.15 * self.reach))
        base = FLOOR if normal @ UP > 0.7 else WALL
        sun, sky = 0.55 * max(tilt, 0.25) ** 0.5, np.exp(-0.9 * contact)
        light = sun * (1 - 0.92 * shadow)[..., None] * SUN + 0.62 * sky[..., None] * SKY
        image = np.empty((texels, texels, 4), np.uint8)
        image[..., :3] = np.clip(base * light * 255 + 0.5, 0, 255)
        from_middle = np.hypot(*np.meshgrid(*[np.linspace(-1, 1, texels)] * 2))
        image[..., 3] = 255 * np.clip((1 - from_middle) / 0.6, 0, 1) ** 1.5 * np.clip(nearest / texel + 1.5, 0, 1)
        actor.texture = pv.Texture(np.ascontiguousarray(image[::-1]))
        actor.texture.interpolate = True

    def draw(self, frame):
        """The picture of one frame, height x width x 3 bytes."""
        own = SNOW[None]
        if self.scene.colour_by:
            particles, kinds = read_particles(self.scene.frames[frame], self.scene.colour_by)
            own = KINDS[kinds.astype(int) % len(KINDS)]
        else:
            particles = read_particles(self.scene.frames[frame])
        own = np.broadcast_to(own, particles.shape)
        window = np.abs(particles - self.centre).max(1) < 3 * self.reach  # nothing lost far away spoils the picture
        if window.any():
            particles, own = particles[window], own[window]
        solids = [solid.place(frame, solid.samples) for solid in self.scene.solids]
        half_spaces = [(h.place(frame, h.point), h.pose(frame)[1] @ h.normal) for h in self.scene.half_spaces]
        within = [solid.place(frame, solid.within) for solid in self.scene.solids]
        fog = Fog(particles, self.scene.spacing, within, half_spaces)
        surface = fog.on_surface(particles)
        shown = particles[surface]
        cubes = pv.PolyData(shown.astype(np.float32))
        cubes["colour"] = (self._shade_cubes(shown, fog, own[surface]) * 255 + 0.5).astype(np.uint8)
        self.cubes.SetInputData(cubes)
        snow = Fog(particles, self.scene.spacing)
        for solid in self.scene.solids:
            position, turn = solid.pose(frame)
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = turn, position
            solid.actor.user_matrix = matrix
            normals = solid.normals @ turn.T
            at = solid.place(frame, solid.points)
            sun = snow.light(at + snow.cell * normals, self.sun, 0.5, 400, step=1.3, growth=1.03)
            sky = snow.sky(at + 0.5 * snow.cell * normals, normals)
            colour = solid.colour * (0.62 * sun[:, None] * SUN + (0.24 + 0.40 * sky[:, None]) * SKY)
            solid.mesh["colour"] = (np.clip(colour, 0, 1) * 255 + 0.5).astype(np.uint8)
        everything = np.concatenate([particles, *solids])
        for half_space, plane, actor in self.planes:
            self._shade_plane(half_space, plane, actor, frame, everything)
        self.plotter.render()
        image = np.asarray(self.plotter.screenshot(return_img=True))[..., :3]
        return np.asarray(Image.fromarray(image).reduce(self.scale))


class PlanePicture:
    """Pictures of plane scenes: `draw` renders one frame, `panels` several moments side by side."""

    def __init__(self, scene, size):
        self.scene, self.size = scene, size
        self.panel = Panel(scene, range(len(scene.frames)))

    def draw(self, frame):
        return draw_panels([(self.panel, frame)], self.size, 1)


class Panel:
    """A plane scene as it is drawn: how its particles are coloured, and the rectangle [m] that its frames need."""

    def __init__(self, scene, frames):
        self.scene = scene
        chosen = {frames[round(i)] for i in np.linspace(0, len(frames) - 1, 16)}
        seen = [self.particles(frame) for frame in chosen]
        at = np.concatenate([points for points, _ in seen] + [o.place(0, o.samples) for o in scene.solids])
        self.low, self.high = np.percentile(at[:, :2], (0.1, 99.9), axis=0) + [[-scene.spacing], [scene.spacing]]
        for mark in scene.marks:
            if mark["frame"] in (-1, *frames):
                axis = mark["axis"]
                self.low[axis] = min(self.low[axis], mark["place"])
                self.high[axis] = max(self.high[axis], mark["place"] + scene.spacing)
        self.fastest = max(np.percentile(values, 99) for _, values in seen)

    def particles(self, frame):
        """Positions [m] of a frame, and the numbers of their kinds or their speeds [m/s]."""
        points, values = read_particles(self.scene.frames[frame], self.scene.colour_by or "velocity")
        return points, values if values.ndim == 1 else np.linalg.norm(values, axis=1)

    def draw(self, axes, frame, low, high, fastest):
        points, values = self.particles(frame)
        size = np.full(len(points), 1.2 * self.scene.spacing)
        dots = matplotlib.collections.EllipseCollection(size, size, np.zeros(len(points)), units="xy", linewidths=0,
                                                        offsets=points[:, :2], offset_transform=axes.transData)
        if self.scene.colour_by:
            dots.set_facecolor([self.colour(int(kind)) for kind in values])
        else:
            dots.set(array=values, cmap="viridis", clim=(0, fastest))
        axes.add_collection(dots)
        far = 4 * float(np.linalg.norm(high - low))
        for half_space in self.scene.half_spaces:
            normal = (half_space.pose(frame)[1] @ half_space.normal)[:2]
            along, at = np.array([-normal[1], normal[0]]), half_space.place(frame, half_space.point)[:2]
            axes.fill(*(at + far * np.array([along, -along, -along - normal, along - normal])).T, color=GROUND)
        for solid in self.scene.solids:
            corners = solid.place(frame, solid.points)[:, :2]
            axes.add_collection(matplotlib.collections.PolyCollection(corners[solid.mesh.regular_faces], color=GROUND))
        for mark in self.scene.marks:
            if mark["frame"] in (-1, frame):
                line = axes.axvline if mark["axis"] == 0 else axes.axhline
                line(mark["place"], color=MARK, linewidth=1.4, linestyle=(0, (4, 2)), label=mark["label"])
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", facecolor=AIR)
        axes.tick_params(labelsize=7, length=2, pad=2)
        axes.locator_params(nbins=4, axis="y")
        axes.set_title(self.scene.title or f"{self.scene.times[frame]:.2f} s", fontsize=8, pad=3)
        return dots

    def colour(self, kind):
        name = self.scene.names[kind] if kind < len(self.scene.names) else None
        return MATERIALS.get(name, tuple(KINDS[kind % len(KINDS)]))


def draw_panels(panels, size, columns):
    """One picture of several (panel, frame), all to the same scale, height x width x 3 bytes."""
    low = np.min([panel.low for panel, _ in panels], axis=0)
    high = np.max([panel.high for panel, _ in panels], axis=0)
    margin = 0.04 * (high - low).max()
    low, high = low - margin, high + margin
    fastest = max(panel.fastest for panel, _ in panels)
    rows = -(-len(panels) // columns)
    figure = matplotlib.figure.Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, layout="constrained")
    canvas = matplotlib.backends.backend_agg.FigureCanvasAgg(figure)
    figure.get_layout_engine().set(w_pad=0.03, h_pad=0.03)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(panels):]:
        axes.set_axis_off()
    for axes, (panel, frame) in zip(grid.flat, panels):
        dots = panel.draw(axes, frame, low, high, fastest)
    for axes in grid[-1]:
        axes.set_xlabel("m", fontsize=7, labelpad=0)
    scene = panels[0][0].scene
    entries = {label: line for axes in grid.flat for line, label in zip(*axes.get_legend_handles_labels())}
    for kind, name in enumerate(scene.names):
        entries[name] = matplotlib.patches.Patch(facecolor=panels[0][0].colour(kind), edgecolor="0.4", linewidth=0.5)
    if not scene.colour_by:
        figure.colorbar(dots, ax=list(grid.flat), aspect=30, fraction=0.04, pad=0.01,
                        format="%.3g").set_label("speed [m/s]", fontsize=8)
        figure.axes[-1].tick_params(labelsize=7, length=2)
    if entries:
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


# ---- the program --------------------------------------------------------------------------------------------------


def choose_frames(text, every, count):
    if text is None:
        chosen = range(count)
    elif ":" in text:
        first, last = (int(part) if part else None for part in text.split(":"))
        chosen = range(count)[first:last]
    else:
        chosen = [int(part) for part in text.split(",")]
    chosen = list(chosen)[::every]
    if not chosen or min(chosen) < -count or max(chosen) >= count:
        stop(f"--frames {text} selects no frame or one that does not exist: there are {count}, from 0 to {count - 1}.")
    return [frame % count for frame in chosen]


def picture_of(scene, size, options):
    if scene.dimensions == 2:
        return PlanePicture(scene, size)
    return Picture(scene, size, options.quality == "best")


def save(image, path, colours=None):
    """Writes a picture, with a palette of so many colours if that is asked for."""
    file = Image.fromarray(image)
    if colours:
        file = file.quantize(colours, kmeans=2, dither=Image.Dither.NONE)
    file.save(path, optimize=bool(colours))


def write_sheet(scenes, size, options):
    """Puts frames of scenes, given with their numbers, into one picture."""
    if len({scene.dimensions for scene, _ in scenes}) > 1:
        stop("a sheet shows plane scenes or others, not both.")
    if scenes[0][0].dimensions == 2:
        panels = [(panel, frame) for scene, frames in scenes for panel in [Panel(scene, frames)] for frame in frames]
        sheet = draw_panels(panels, size, options.columns)
    else:
        rows = -(-sum(len(frames) for _, frames in scenes) // options.columns)
        part = (size[0] // options.columns, size[1] // rows)
        images = []
        for scene, frames in scenes:
            picture = picture_of(scene, part, options)
            images += [picture.draw(frame) for frame in frames]
        sheet = np.full((part[1] * rows, part[0] * options.columns, 3), 255, np.uint8)
        for i, image in enumerate(images):
            top, left = i // options.columns * part[1], i % options.columns * part[0]
            sheet[top: top + part[1], left: left + part[0]] = image
    try:
        options.sheet.parent.mkdir(parents=True, exist_ok=True)
        save(sheet, options.sheet, 64 if scenes[0][0].dimensions == 2 else 256)
    except (OSError, ValueError) as error:
        stop(f"the picture cannot be written ({error}).")
    print(f"{options.sheet} ({options.sheet.stat().st_size / 1000:.0f} kB)")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", metavar="DIR", type=Path, nargs="+",
                        help="the simulation's output folder; several for one --sheet")
    parser.add_argument("--frames", help="which ones: '0,10,-1' or 'first:end' (default: all)")
    parser.add_argument("--every", type=int, default=1, help="take each n-th of them; the video keeps its speed")
    parser.add_argument("--size", default="1280x720", help="pixels, both even (default: %(default)s)")
    parser.add_argument("--quality", choices=("fast", "best"), default="fast",
                        help="best: ambient occlusion between the cubes, some three times slower")
    parser.add_argument("--palette", action="store_true", help="256-colour pictures: about a third of the size")
    parser.add_argument("--sheet", metavar="FILE", type=Path,
                        help="put the chosen frames into this one picture with a palette, and write nothing else")
    parser.add_argument("--columns", type=int, default=1, help="of the frames on a sheet (default: %(default)s)")
    parser.add_argument("--no-video", action="store_true", help="pictures only")
    options = parser.parse_args()
    try:
        width, height = (int(part) for part in options.size.lower().split("x"))
        frame_choice = options.frames and all(part.lstrip("-").isdigit() or not part
                                              for part in options.frames.replace(":", ",").split(","))
        if width < 64 or height < 64 or width % 2 or height % 2 or options.every < 1 or options.columns < 1 or frame_choice is False:
            raise ValueError
    except ValueError:
        stop("--size needs two even numbers such as 1280x720, --every and --columns positive ones, --frames numbers.")
    if len(options.folders) > 1 and not options.sheet:
        stop("several folders make one --sheet; name one folder for pictures and a video.")
    if not os.environ.get("DISPLAY"):
        names = {"EGL": "vtkEGLRenderWindow", "OSMesa": "vtkOSOpenGLRenderWindow"}
        usable = [window for library, window in names.items() if ctypes.util.find_library(library)]
        if not usable:
            stop("drawing without a screen needs the library libEGL (Debian: libegl1 and libgl1-mesa-dri).")
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", usable[0])
    vtk.vtkObject.GlobalWarningDisplayOff()

    scenes = [Scene(folder) for folder in options.folders]
    if options.sheet:
        chosen = [choose_frames(options.frames, options.every, len(scene.frames)) for scene in scenes]
        return write_sheet(list(zip(scenes, chosen)), (width, height), options)
    scene = scenes[0]
    frames = choose_frames(options.frames, options.every, len(scene.frames))
    film = len(frames) > 1 and not options.no_video
    writer = None
    try:
        pictures = scene.folder / "pictures"
        pictures.mkdir(exist_ok=True)
        if len(frames) == len(scene.frames):
            for earlier in pictures.glob("frame_*.png"):
                earlier.unlink()
        if film:
            import imageio
            writer = imageio.get_writer(scene.folder / "video.mp4", fps=scene.frames_per_second / options.every,
                                        codec="libx264", pixelformat="yuv420p", quality=8, macro_block_size=2,
                                        ffmpeg_log_level="error")
        started = time.monotonic()
        picture = picture_of(scene, (width, height), options)
        for done, frame in enumerate(frames, 1):
            image = picture.draw(frame)
            save(image, pictures / f"frame_{frame:04d}.png", 256 if options.palette else None)
            if writer:
                writer.append_data(image)
            if sys.stderr.isatty():
                left = (time.monotonic() - started) / done * (len(frames) - done)
                print(f"\rframe {done} of {len(frames)}, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
        if writer:
            writer.close()
    except ImportError as missing:
        stop(f"the Python package '{missing.name}' is missing: pip install imageio imageio-ffmpeg")
    except OSError as error:
        stop(f"the pictures cannot be written ({error}).")
    if sys.stderr.isatty():
        print(file=sys.stderr)
    seconds = (time.monotonic() - started) / len(frames)
    print(f"{len(frames)} pictures in {pictures} ({seconds:.2f} s each)" +
          (f", video in {scene.folder / 'video.mp4'}" if film else ""))


if __name__ == "__main__":
    main()
