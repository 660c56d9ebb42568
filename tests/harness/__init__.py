"""What tests of the service share: made-up demonstrations, a bridge without a network, a peer with one."""
