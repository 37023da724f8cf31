"""One typed record for each file that the package writes, each with one reader and one writer."""
