"""Text, sound and HDF5, as far as readers and writers of files share them."""
