defmodule BB.Test.Eventually do
  @moduledoc "For what becomes true without telling anyone."

  @doc "Whether `check` returns something true within five seconds."
  def eventually(check, tries \\ 500)
  def eventually(_check, 0), do: false

  def eventually(check, tries) do
    check.() ||
      receive do
      after
        10 -> eventually(check, tries - 1)
      end
  end
end
