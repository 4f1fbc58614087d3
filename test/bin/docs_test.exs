defmodule Bin.DocsTest do
  @moduledoc "Tests the checks of `bin/docs`. `bin/test docs` builds the whole site."

  use ExUnit.Case, async: true

  alias BB.Test.Run

  setup do
    site = Path.join(System.tmp_dir!(), Run.unique("site"))
    File.mkdir_p!(Path.join(site, "guides"))
    on_exit(fn -> File.rm_rf!(site) end)
    page(site, "index.html", ~s(<h1 id="top">here</h1> <a href="guides/a.html#end">on</a>))

    page(
      site,
      "guides/a.html",
      ~s(<p id="end"></p> <a href="../#top">back</a> <a href="#end">end</a>)
    )

    %{site: site}
  end

  test "accepts links that resolve, also to other hosts", %{site: site} do
    page(
      site,
      "b.html",
      ~s(<a href="https://example.org/x">there</a> <a href="guides/a.html">a</a>)
    )

    assert check(site) == {"", 0}
  end

  test "reports a broken link with its page", %{site: site} do
    page(site, "b.html", ~s(<a href="guides/c.html">c</a>))
    assert {said, 1} = check(site)
    assert said == "#{real(site)}/b.html: guides/c.html is broken\n"
  end

  test "reports a link to an anchor that its page does not have", %{site: site} do
    page(site, "b.html", ~s(<a href="guides/a.html#start">a</a>))
    assert {said, 1} = check(site)
    assert said =~ "b.html: guides/a.html#start: that page has no such anchor"
  end

  test "reports a page that loads a file from another host", %{site: site} do
    for {tag, url} <- [
          {~s(<script src="https://cdn.example.org/x.js"></script>),
           "https://cdn.example.org/x.js"},
          {~s(<link rel="stylesheet" href="//fonts.example.org/y.css">),
           "//fonts.example.org/y.css"},
          {~s(<img src="http://example.org/z.png">), "http://example.org/z.png"}
        ] do
      page(site, "b.html", tag)
      assert {said, 1} = check(site)
      assert said =~ "b.html: fetches #{url} from another host"
    end
  end

  test "does not read folders that another tool has checked", %{site: site} do
    page(site, "rust/ring.html", ~s(<a href="nowhere.html">x</a>))
    page(site, "b.html", ~s(<a href="rust/ring.html">ring</a>))
    assert check(site, [Path.join(site, "rust")]) == {"", 0}
    assert {_, 1} = check(site)
  end

  test "reports invalid arguments in one line" do
    for arguments <- [~w(--sreve), ~w(--serve eighty), ~w(--serve 80 81)] do
      assert {said, 2} = System.cmd(Path.expand("bin/docs"), arguments, stderr_to_stdout: true)
      assert said =~ "--serve"
      assert length(String.split(said, "\n", trim: true)) == 1
    end
  end

  defp page(site, name, body) do
    File.mkdir_p!(Path.dirname(Path.join(site, name)))
    File.write!(Path.join(site, name), "<html><body>#{body}</body></html>")
  end

  defp check(site, not_read \\ []) do
    arguments = [Path.expand("docs/site/links.py"), site | not_read]
    System.cmd("python3", arguments, stderr_to_stdout: true)
  end

  # Links of the file system are followed.
  defp real(site) do
    {path, 0} = System.cmd("realpath", [site])
    String.trim(path)
  end
end
