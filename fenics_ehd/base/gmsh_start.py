"""Import of Gmsh: Python's handler of Ctrl-C is kept, and missing system libraries are reported.

PyPI's Gmsh contains its graphical window, whose libraries belong to the system. Without them Gmsh
cannot be imported, even if no window is opened.
"""

from fenics_ehd.base.errors import LibraryError
from fenics_ehd.base.processes import interrupt_kept

#: Commands that install the libraries of Gmsh's window.
INSTALL = (
    "apt-get install libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 (Debian, Ubuntu), or "
    "dnf install mesa-libGLU libXcursor libXft libXinerama (Fedora, RHEL)"
)

try:
    with interrupt_kept():
        import gmsh  # noqa: F401
except OSError as error:  # from the dynamic loader
    raise LibraryError(f"Gmsh lacks a library of the system: {error}: {INSTALL}") from error
