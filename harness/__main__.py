"""`python -m harness` is `bench`."""

from harness.supervisor import main

if __name__ == "__main__":
    main()
