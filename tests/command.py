"""The command line inside a test: a scene file in a working folder, and what a command says."""

from jaxrt import cli
from jaxrt.cli import start

BALL = """
[camera]
position = [0, 0, 30]
width    = 16
height   = 12

[render]
spp       = 2
max_depth = 1

[materials.white]
type   = "diffuse"
albedo = [0.8, 0.8, 0.8]

[[spheres]]
center   = [0, 0, 0]
radius   = 10
material = "white"

[[lights]]
position  = [-10, 20, 30]
intensity = 2000
"""


def working_folder(path, monkeypatch, ball=BALL):
    """Return the path, made the working folder, with ball.toml in it; JAX keeps the tests' devices and cache."""
    monkeypatch.chdir(path)
    monkeypatch.setattr(start, "start_jax", lambda cores: None)
    (path / "ball.toml").write_text(ball)
    return path


def run(capsys, *argv):
    """Return the exit status and what went to stdout and stderr."""
    status = cli.main([str(a) for a in argv])
    captured = capsys.readouterr()
    return status, captured.out, captured.err
