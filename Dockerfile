# docker build -t fenics-ehd .
# mkdir -p results
# docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/results:/results" fenics-ehd \
#   run slider-crank --overwrite -o /results/slider-crank
# docker run --rm --entrypoint python fenics-ehd -m pytest /opt/fenics_ehd/tests
# docker run --rm --entrypoint mpirun fenics-ehd -n 2 fenics-ehd reduce conrod -o /tmp/conrod.h5
FROM debian:trixie-slim

# Before the project, so that an edited file does not install 500 packages again.
COPY debian-packages.txt /opt/fenics_ehd/
RUN apt-get update \
 && sed 's/#.*//' /opt/fenics_ehd/debian-packages.txt \
    | DEBIAN_FRONTEND=noninteractive xargs apt-get install -y --no-install-recommends \
 && rm -rf /var/lib/apt/lists/*

# Whoever --user names must find a home to write to: FFCx compiles forms into ~/.cache, Matplotlib
# lists the fonts there. To keep what other scenes add, mount a volume at /home/ehd.
RUN useradd --uid 1000 ehd \
 && mkdir -p /home/ehd/.cache/fenics /home/ehd/.cache/matplotlib /home/ehd/.config/matplotlib \
 && chmod -R 1777 /home/ehd \
 && install -d -m 777 /results
ENV HOME=/home/ehd
ENV PATH=/opt/venv/bin:/usr/bin:/bin

# Installed, not run from the checkout: what a package forgot to ship fails here.
COPY . /opt/fenics_ehd
RUN /usr/bin/python3 -m venv --system-site-packages /opt/venv \
 && pip install --no-cache-dir --no-deps --no-build-isolation /opt/fenics_ehd \
 && rm -rf /opt/fenics_ehd/build /opt/fenics_ehd/*.egg-info

# Forms of the shipped scenes, compiled in advance. Of everybody: who comes next adds to them.
RUN printf '%s\n' \
      'import fenics_ehd as ehd' \
      'from fenics_ehd.multibody.mechanism import System' \
      'from fenics_ehd.scenes.library import shipped_names' \
      'for name in shipped_names():' \
      '    for place in System(ehd.build(ehd.read_scene(name)).mechanism).films:' \
      '        place.film.film.equation.forms' \
    | FENICS_EHD_CACHE=off OMP_NUM_THREADS=1 python - \
 && chmod -R a+rwX /home/ehd/.cache

# One thread per rank, and no pytest cache beside tests that this user cannot write to.
ENV OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTEST_ADDOPTS="-p no:cacheprovider"
USER ehd
# Where results/SCENE, the default of --output, is inside the mounted folder.
WORKDIR /
ENTRYPOINT ["fenics-ehd"]
