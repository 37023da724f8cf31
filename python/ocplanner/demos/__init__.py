"""Reading and writing data sets of demonstrations of any origin."""
