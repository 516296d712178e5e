"""What people read: the report, the notebooks' pages, a cell's story on a terminal, the errata sheet, the article."""
