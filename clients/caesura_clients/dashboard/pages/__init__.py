"""The pages, each a thin layer between the gateway's state and one component."""
