PYTHON ?= python3

install: ; @$(PYTHON) tools/install.py run
