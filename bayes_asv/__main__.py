"""``python -m bayes_asv`` is the command ``bayes-asv``."""

import os
import sys
from typing import NoReturn

__all__ = ["main"]


def main() -> NoReturn:
    """Import the command line and run it; Ctrl-C during the import ends in one line as well."""
    # Matrices are small: more threads of the linear algebra only wait for each other, and they add
    # in another order, so that the same seed would not give the same last digits.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    try:
        from bayes_asv.cli import main as run
    except KeyboardInterrupt:
        sys.stderr.write("bayes-asv: interrupted\n")
        os._exit(130)
    run()


if __name__ == "__main__":
    main()
