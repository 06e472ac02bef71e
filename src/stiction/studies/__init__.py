"""The experiments behind the results, a folder each. The product never imports one."""
