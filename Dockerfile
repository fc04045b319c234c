# APVI-SLAM in a container.
#
#   docker build -t apvi .                                  # CPU
#   docker build -t apvi-cuda --build-arg BACKEND=cuda .    # mapping on an NVIDIA GPU
#   docker run --rm -v "$PWD:/data" apvi run my_dive/ -o runs/my_dive
#   docker run --rm --gpus all -v "$PWD:/data" apvi-cuda run my_dive/ -o runs/my_dive
#
# Build arguments: DEBIAN (12 or 13; BACKEND=cuda needs 12), BACKEND (cpu or cuda), CUDA_ARCHITECTURES (compute
# capabilities of the GPUs; default: those of scripts/cmake/ApviCuda.cmake), JOBS (parallel compilers; default: by
# processors and memory).
# The stages dev-cpu and dev-cuda contain the tools and libraries only; .devcontainer uses dev-cpu.
ARG DEBIAN=12
ARG BACKEND=cpu

FROM debian:${DEBIAN} AS dev-cpu
ENV DEBIAN_FRONTEND=noninteractive
COPY scripts/packages.txt scripts/setup.sh /opt/apvi-setup/scripts/
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates \
  && APVI_LPIPS=none /opt/apvi-setup/scripts/setup.sh \
  && rm -rf /var/lib/apt/lists/*

# NVIDIA's CUDA toolkit, and the LibTorch in the Python package torch, built with the same CUDA version.
FROM dev-cpu AS dev-cuda
ADD https://developer.download.nvidia.com/compute/cuda/repos/debian12/x86_64/cuda-keyring_1.1-1_all.deb /opt/apvi-setup/
RUN dpkg -i /opt/apvi-setup/cuda-keyring_1.1-1_all.deb && apt-get update \
  && apt-get install -y --no-install-recommends cuda-nvcc-13-0 cuda-libraries-dev-13-0 \
  && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/torch && /opt/torch/bin/pip install --no-cache-dir torch==2.11.0
ENV PATH=/usr/local/cuda-13.0/bin:$PATH \
    CMAKE_PREFIX_PATH=/opt/torch/lib/python3.11/site-packages/torch

FROM dev-${BACKEND} AS build
ARG BACKEND=cpu
ARG CUDA_ARCHITECTURES=
ARG JOBS=
COPY . /src
WORKDIR /src
SHELL ["/bin/bash", "-c"]
RUN . scripts/lib.sh \
  && cmake --preset "$BACKEND" -DAPVI_BUILD_TESTS=OFF \
    ${CUDA_ARCHITECTURES:+-DCMAKE_CUDA_ARCHITECTURES="$CUDA_ARCHITECTURES"} \
  && cmake --build --preset "$BACKEND" --parallel "${JOBS:-$(jobs_for_build)}" \
  && cmake --install "build/$BACKEND" --prefix /opt/apvi

# Keeps the compilers, so that programs can be built against the library in /opt/apvi.
FROM dev-${BACKEND}
COPY --from=build /opt/apvi /opt/apvi
ENV PATH=/opt/apvi/bin:$PATH MANPATH=/opt/apvi/share/man:
WORKDIR /data
ENTRYPOINT ["apvi"]
CMD ["--help"]
