"""The pages, tables and files that the study of the paper is published as."""
