"""SlipAvoidGrasp: the least force that holds, with no knowledge of the weight."""
