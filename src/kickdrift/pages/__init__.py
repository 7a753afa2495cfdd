"""Pages that compute: kickdrift's own step loops as WebAssembly, in one HTML file that any browser runs.

It imports from the layers above `cli`. The command line uses `write_page`."""
