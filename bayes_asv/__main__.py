"""``python -m bayes_asv`` is the command ``bayes-asv``."""

from bayes_asv.cli import main

if __name__ == "__main__":
    main()
