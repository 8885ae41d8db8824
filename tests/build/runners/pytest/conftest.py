pytest_plugins = ["porttape.pytest"]
