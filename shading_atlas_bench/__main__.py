"""`python -m shading_atlas_bench` is `bench`."""

from shading_atlas_bench.harness.cli.supervisor import main

if __name__ == "__main__":
    main()
