"""The controllers: each file is an executable that launch files and page offer by its name."""
