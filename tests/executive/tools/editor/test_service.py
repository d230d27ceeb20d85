def test_a_list_of_users_is_no_tree():
    from pomona.tools.editor.service import is_tree

    assert not is_tree("root:x:0:0:root:/root:/bin/bash\ndaemon:x:1:1::/usr/sbin:/bin/sh\n")
    assert is_tree("pomona: 1\ntree: t\nroot:\n  wait: 1 s\n")
