"""What a solve will build and cost, before it is built."""
