"""Render the room of the README: load a scene, draw it, save it.

python examples/render_room.py
"""

import time

from figure import arguments

import jaxrt

options = arguments(__doc__)
scene = jaxrt.load_scene("scenes/room.toml")

# The first call compiles, the second only draws: same scene structure, same program, other random numbers
spp = 1 if options.quick else 64
for key in (0, 1):
    start = time.perf_counter()
    image = jaxrt.render(scene, key, spp=spp).block_until_ready()
    print(f"key {key}: {image.shape[1]}x{image.shape[0]}, {spp} spp, {time.perf_counter() - start:.2f} s")

# A scene is a pytree, its parameters are arrays: another colour is another value, not another program
for name, value in jaxrt.parameters(scene).items():
    print(f"  {name} {value.shape}")
albedo = jaxrt.parameters(scene)["materials.albedo"]
pink = jaxrt.with_parameters(scene, {"materials.albedo": albedo.at[6].set([0.9, 0.4, 0.5])})
start = time.perf_counter()
image = jaxrt.render(pink, 0, spp=spp).block_until_ready()
print(f"pink ball: {time.perf_counter() - start:.2f} s")

jaxrt.save_image(options.output / "render_room.png", image)
print(f"mean radiance {float(image.mean()):.4f}; picture: {options.output / 'render_room.png'}")
