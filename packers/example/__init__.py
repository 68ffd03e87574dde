"""The smallest packer."""
