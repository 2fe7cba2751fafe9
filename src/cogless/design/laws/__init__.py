"""Design of each law: its learning loop, its rule and what it certifies. A file has the name of its law."""
