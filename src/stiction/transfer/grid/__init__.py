"""One evaluation over everything: policy by engine by law by level by ground by command, walk by walk."""
