"""A live session for viewers of other projects. Data flows one way: a viewer changes nothing."""
