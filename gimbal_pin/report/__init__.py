"""What a person sees: tables in the terminal, pages, scenes, and the pipeline that makes all of them."""
