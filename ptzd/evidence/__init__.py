"""What people look at: stories, pages, pictures, tables and viewer documents, made from what was logged."""
