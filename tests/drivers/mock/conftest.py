pytest_plugins = ["drivers.mock.fixtures"]
